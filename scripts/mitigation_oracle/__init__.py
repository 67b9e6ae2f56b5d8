"""What scripts/mitigation-oracle computes: golden values of mitigations, one file for each kind."""
