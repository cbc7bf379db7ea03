"""Requests and transfers to the nodes, with retries and supervision."""
