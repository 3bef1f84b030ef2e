"""Shared by all studies: command line, timing, machine facts, pages, tables and charts."""
