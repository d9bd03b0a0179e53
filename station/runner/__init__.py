"""From a plan and a bench to a sealed run folder."""
