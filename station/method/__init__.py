"""How a procedure is declared: commands, work and what follows from them."""
