"""The paper's studies: what they need, who does it, what was found, how it is drawn."""
