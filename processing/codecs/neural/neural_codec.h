/* The codec "neural": neural planes with measured parallax (neural.h). */
#pragma once

#include "codecs/codec/codec.h"

extern const struct codec neural_codec;
