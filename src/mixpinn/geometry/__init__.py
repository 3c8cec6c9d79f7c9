"""Geometry without physics: triangles, rays, rotations, rigid fits, shapes of probes."""
