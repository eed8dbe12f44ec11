/*
 * Pictures of what the demo measured next to the truth. Pure functions over plain data.
 */
#pragma once

#include "exr/exr.h"
#include "session/session.h"

/* Three panels: measured, true, measured − true over ± a quarter of a texel, with captions. */
gboolean demo_write_mdf(const char *path, const struct session_grid *grid, const float *measured,
                        const float *truth, GError **error);

#define DEMO_BTF_COLUMNS 6

struct demo_btf;
struct demo_btf *demo_btf_new(const struct session_grid *grid);
void demo_btf_free(struct demo_btf *btf); /* NULL is ignored */
/* A column a pair of view and light: measured, true, and four times the difference around grey, one
 * below the other. FALSE: it is full. */
gboolean demo_btf_add(struct demo_btf *btf, const struct exr_part *part,
                      const struct session_direction *view, const struct session_direction *light,
                      const float *truth);
int demo_btf_columns(const struct demo_btf *btf); /* that are there */
gboolean demo_btf_write(const struct demo_btf *btf, const char *path, GError **error);
