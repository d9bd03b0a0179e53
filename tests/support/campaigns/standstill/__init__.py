"""What an operating system may do to a run: cases, attacks, runs under attack, one oracle."""
