/* Umbrella header for the desktop: the core and the host library (heap, FFTW, NLopt, SuiteSparse). Double precision only. */
#ifndef GSID_HOST_H
#define GSID_HOST_H

#include "gsid/effect_facts.h"
#include "gsid/gsid.h"
#include "gsid/host/axis.h"
#include "gsid/host/batch.h"
#include "gsid/host/build_info.h"
#include "gsid/host/compare.h"
#include "gsid/host/fit.h"
#include "gsid/host/greybox.h"
#include "gsid/host/law_columns.h"
#include "gsid/host/mimo.h"
#include "gsid/host/misfit.h"
#include "gsid/host/optimise_excitation.h"
#include "gsid/host/plant_fit.h"
#include "gsid/host/pool.h"
#include "gsid/host/squares.h"
#include "gsid/host/steady.h"
#include "gsid/host/structure.h"
#include "gsid/host/tail.h"
#include "gsid/host/transform.h"

#ifdef GSID_SINGLE
#error "the host library is double precision only"
#endif

#endif
