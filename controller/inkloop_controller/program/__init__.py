"""The layer problem as a mathematical program in CasADi, and certified bounds."""
