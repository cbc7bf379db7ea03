"""The layer problem: what a plan is judged by, and how much work it may take."""
