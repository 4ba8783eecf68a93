"""Excitations: multisines, binary sequences, sines; within the limits of a rig."""
