"""Controllers to compare with: open loop, error diffusion, greedy feedback, the paper's search."""
