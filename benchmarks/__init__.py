"""Tests of tipforce against worlds that share nothing with its own renderer and solver."""
