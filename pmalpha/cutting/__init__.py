"""From one structure to subdomains: cut, choose substeps, put together again."""
