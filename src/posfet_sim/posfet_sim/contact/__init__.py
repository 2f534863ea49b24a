"""Contact mechanics: the force of an object on each taxel. Knows no scene."""
