/* A file of reflectance fields in which all texels are equal. */
#pragma once

#include "codecs/lobes/lobes.h"
#include "view_fixture.h"

void fields_fixture_write(const char *path, int width, int height);
