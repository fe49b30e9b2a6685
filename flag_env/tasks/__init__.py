"""What is asked of an agent: target poses that are known to be reachable, and rewards."""
