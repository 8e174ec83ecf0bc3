"""What the documentation shows of the code: tables, commands, messages and modules, each made from its only declaration.

`python tests/unit/test_docs.py` writes the tables into the READMEs; the site makes the rest when it is built.
"""
