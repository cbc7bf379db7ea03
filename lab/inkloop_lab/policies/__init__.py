"""Policies: observation and action of a layer, policies as controllers, and controllers as policies."""
