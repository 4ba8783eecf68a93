/* Between what is shared with an interrupt and the volatile word that hands it over. `volatile` orders volatile accesses among
 * themselves; the compiler may move all others across them. Needed on the side that can be interrupted, before it gives and
 * after it is given: the interrupt itself is one instant to it. One core keeps its own order; with two of them this is the
 * processor's barrier. */
#ifndef HANDOVER_H
#define HANDOVER_H

#define HANDOVER() __asm__ volatile("" ::: "memory")

#endif
