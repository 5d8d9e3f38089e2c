"""From the list of a paper's campaigns to its figures and tables, beside what the paper says."""
