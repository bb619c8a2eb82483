"""Scores of the commands, on files as users have them: `make scores`.

The product is run by its commands alone; truths and peers share no code with it.
"""
