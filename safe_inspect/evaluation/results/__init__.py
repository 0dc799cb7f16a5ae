"""What evaluated episodes give: collected figures, recorded states, statistics, tables, comparisons and files."""
