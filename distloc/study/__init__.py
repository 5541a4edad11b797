"""The paper's study, and what goes beyond it: results as values and figures; who calls it writes the files."""
