"""Files of other people as tables: named columns of numbers with their units, before it is known what they mean."""

from amb_core.data.tables.read import ENDINGS, Content, load_content, tables_of
from amb_core.data.tables.table import Column, Table

__all__ = ["ENDINGS", "Column", "Content", "Table", "load_content", "tables_of"]
