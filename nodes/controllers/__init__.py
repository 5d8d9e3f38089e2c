"""Controllers: what input an estimate asks for."""
