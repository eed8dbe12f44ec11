/* Shared by the fuzz targets. A reader that needs a path gets that of a file in memory. */
#pragma once

#include <glib.h>
#include <stddef.h>
#include <stdint.h>

/* Pictures of more pixels are refused before they are decoded: they would be slow. */
#define FUZZ_MAX_PIXELS 1000000

/* checkpoint_begin(): inputs of the checkpoints that fuzz_seeds writes. */
#define FUZZ_CHECKPOINT_INPUTS "fuzz"

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size);

/* Returns the path of a file with these bytes. Every call writes the same file. The fuzzer owns the
 * path. */
const char *fuzz_file(const uint8_t *data, size_t size);

/* The same as a named file in a folder of its own, for readers that look next to it. */
const char *fuzz_file_in_folder(const char *name, const uint8_t *data, size_t size);

/* Returns the bytes as text that ends with 0. Free it with g_free(). */
char *fuzz_text(const uint8_t *data, size_t size);

/* Every refusal has to say why: an error that is not set, or set next to a result, is a bug. Frees
 * the error, for the next reader. */
void fuzz_check(gboolean ok, GError **error);
