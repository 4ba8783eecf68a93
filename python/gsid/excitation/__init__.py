"""Excitation signals: multisines, binary sequences, swept and stepped sines, and the limits of a rig."""
