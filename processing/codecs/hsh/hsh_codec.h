/* Hemispherical harmonics as a codec. */
#pragma once

#include "codecs/codec/codec.h"

extern const struct codec hsh_codec; /* its models are struct hsh */
