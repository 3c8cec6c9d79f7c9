"""Tests of the anatomy layer."""
