"""Studies that use inkloop as a library: the papers reproduced, the score board."""
