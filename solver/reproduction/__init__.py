"""The paper's figures computed again, and their pictures."""
