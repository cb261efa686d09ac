"""What commands show: results on a terminal, help, pages in a browser."""
