"""What scripts/bench is made of: the machine, the programs, the measurements, and their tables."""
