/* Small worlds, written to a temporary folder and loaded. */
#pragma once

#include "world/world.h"

#include <glib/gstdio.h>
#include <math.h>
#include <unistd.h>

char *world_fixture_folder(void);
char *world_fixture_write(const char *name, const char *text);
World *world_fixture_new(const char *text);
void world_fixture_clean(void);

/* Adds an axis-aligned box without a bottom, as lines of an OBJ file. n is the number of vertices
 * that obj already has. */
void world_fixture_box(GString *obj, int n, double x0, double x1, double y0, double y1, double z);
