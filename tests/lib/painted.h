/* A picture that a virtual camera delivers, and a check that a frame contains it. */
#pragma once

#include "drivers/frame.h"
#include "virtual/cameras/imager.h"

#define PAINTED_WIDTH  66
#define PAINTED_HEIGHT 34

void painted_paint(const struct virtual_exposure *exposure, gpointer data, guint16 *pixels);
void painted_assert(const Frame *frame, int x0, int y0, int shift);
