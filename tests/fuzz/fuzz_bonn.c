/* Bonn's .btf container, all kinds. */
#include "fuzz.h"

#include "formats/bonn/bonn.h"

#define MOST 1000000 /* values of a view that are worth reading here */

int LLVMFuzzerTestOneInput(const uint8_t *data, size_t size) {
    GError *error = NULL;
    g_autoptr(BonnFile) file = bonn_open(fuzz_file(data, size), &error);
    fuzz_check(file != NULL, &error);
    const struct bonn_header *header = file ? bonn_header(file) : NULL;
    if (!header || header->n_views < 1 ||
        3.0 * header->n_lights * header->width * header->height > MOST)
        return 0;
    const gsize n = 3 * (gsize)header->n_lights * (gsize)header->width * (gsize)header->height;
    g_autofree float *rgb = g_new(float, n);
    g_autofree int *holes = g_new(int, header->n_lights);
    bonn_read_view(file, 0, rgb, holes, NULL);
    bonn_read_view(file, header->n_views - 1, rgb, holes, NULL);
    return 0;
}
