"""Tests of the paper's sections: printed values, the study and the independent oracle agree."""
