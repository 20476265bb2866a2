"""Prints the rows of a Parquet file, read by DuckDB, as JSON.

    engines_table.py FILE
"""

import json
import sys

import duckdb

table = duckdb.read_parquet(sys.argv[1])
print(json.dumps([dict(zip(table.columns, row)) for row in table.fetchall()]))
