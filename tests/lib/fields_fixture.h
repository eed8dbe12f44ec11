/* A file of reflectance fields whose texels are all alike. */
#pragma once

#include "codecs/lobes/lobes.h"
#include "view_fixture.h"

void fields_fixture_write(const char *path, int width, int height);
