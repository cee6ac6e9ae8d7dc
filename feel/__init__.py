"""What skin and ears get from waves over time: what is felt, heard, and how loud it is where people sit."""
