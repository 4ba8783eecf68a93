/* Umbrella header for firmware: the core only, which links nothing but libm. */
#ifndef GSID_H
#define GSID_H

#include "gsid/catalogue.h"
#include "gsid/distortion.h"
#include "gsid/effect.h"
#include "gsid/estimate.h"
#include "gsid/excitation.h"
#include "gsid/expression.h"
#include "gsid/frd.h"
#include "gsid/frf.h"
#include "gsid/guard.h"
#include "gsid/link.h"
#include "gsid/lsq.h"
#include "gsid/plant.h"
#include "gsid/rational.h"
#include "gsid/signals.h"
#include "gsid/spectrum.h"
#include "gsid/spread.h"
#include "gsid/table.h"
#include "gsid/types.h"

#endif
