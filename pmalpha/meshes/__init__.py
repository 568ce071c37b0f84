"""Kinds of elements, checked meshes, and constraints between the meshes of subdomains."""
