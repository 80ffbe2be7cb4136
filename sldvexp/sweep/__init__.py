"""Many runs as one: what was asked for, what is done, and one dataset of the results."""
