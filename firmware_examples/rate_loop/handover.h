/* Compiler barrier between data shared with an interrupt and the volatile word that hands them over. `volatile` orders volatile
 * accesses among themselves only; the compiler may move all others across them. The side that can be interrupted needs the
 * barrier, before it hands data over and after it receives them. The interrupt does not: to the other side it is one instant.
 * A single core keeps its own order; with two cores use the processor's memory barrier here. */
#ifndef HANDOVER_H
#define HANDOVER_H

#define HANDOVER() __asm__ volatile("" ::: "memory")

#endif
