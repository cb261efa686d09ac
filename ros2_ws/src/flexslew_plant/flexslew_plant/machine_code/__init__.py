"""Machine code that is kept on disk between runs, and shared between processes.

Offers: cache_names, compile_errors, compile_lock, compile_news, frame, processor, read_only.
"""
