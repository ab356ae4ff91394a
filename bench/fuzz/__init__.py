"""Mutated logs and configs: does any of them crash, hang, or write outside of its folder?"""
