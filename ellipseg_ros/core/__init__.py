"""The method, one stage a file; segmenter.py joins them."""
