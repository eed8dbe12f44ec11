/* A small BTF with a highlight, and its files in every codec: for tests of libmesorig-material. */
#pragma once

#include "btf_fixture.h"
#include "codecs/codecs.h"

#define MATERIAL_WIDTH  6
#define MATERIAL_HEIGHT 5

/* Smooth and positive; views and lights on two rings, with the pole among them or without. */
struct btf_matrix *material_fixture_btf(gboolean with_pole);
/* The same of any size. */
struct btf_matrix *material_fixture_sized(int width, int height, int rings, gboolean with_pole);

/* Encodes and writes it. options: "name=value name=value", as on the command line; "": defaults. */
void material_fixture_write(const char *path, const struct codec *codec,
                            const struct btf_matrix *btf, const char *options);

/* A new session directory with this BTF and nothing else. */
void material_fixture_write_session(const char *path, const struct btf_matrix *btf);
