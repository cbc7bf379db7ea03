"""The layer problem: the objective of a plan, and its work budget."""
