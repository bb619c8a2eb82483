"""The paper's figures, remade: pictures with their numbers."""
