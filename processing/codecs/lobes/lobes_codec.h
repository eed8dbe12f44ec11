/* The analytic models of a texel as codecs. */
#pragma once

#include "codecs/codec/codec.h"
#include "lobes.h"

extern const struct codec lobes_codecs[LOBES_MODELS]; /* in the order of enum lobes_model */
