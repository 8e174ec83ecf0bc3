"""What the documentation shows of the code: tables, commands, messages and modules, from their only declarations.

`python -m tests.unit.test_docs` writes the tables into the READMEs; the site makes the rest when it is built.
"""
