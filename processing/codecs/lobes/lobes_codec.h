/* The analytic models of lobes.h as codecs. */
#pragma once

#include "codecs/codec/codec.h"
#include "lobes.h"

extern const struct codec lobes_codecs[LOBES_MODELS]; /* in the order of enum lobes_model */
