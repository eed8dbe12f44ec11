/* Local PCA as a codec. */
#pragma once

#include "codecs/codec/codec.h"
#include "lpca.h"

extern const struct codec lpca_codec;
