/* A small BTF with a highlight, and its files in every codec, for tests of libmesorig-material. */
#pragma once

#include "btf_fixture.h"
#include "codecs/codecs.h"

#define MATERIAL_WIDTH  6
#define MATERIAL_HEIGHT 5

/* Makes a BTF with smooth, positive values. Views and lights are on two rings. with_pole adds the
 * pole to both. */
struct btf_matrix *material_fixture_btf(gboolean with_pole);
/* Does the same with any size and number of rings. */
struct btf_matrix *material_fixture_sized(int width, int height, int rings, gboolean with_pole);

/* Encodes the BTF and writes the file. options is "name=value name=value", as on the command line;
 * "" means the defaults. */
void material_fixture_write(const char *path, const struct codec *codec,
                            const struct btf_matrix *btf, const char *options);

/* Makes a session directory that contains only this BTF. */
void material_fixture_write_session(const char *path, const struct btf_matrix *btf);
