/* Evaluates a .bsdf, for peers/formats_mitsuba.py: bsdf_values FILE.bsdf PAIRS > VALUES.
 * PAIRS has six floats per pair, the unit vectors of light and view. VALUES has f_r, three floats
 * per pair: R, G, B. */
#include <stdio.h>
#include <stdlib.h>

#include "formats/brdf/rgl.h"

int main(int argc, char **argv) {
    g_autoptr(GError) error = NULL;
    g_autofree char *bytes = NULL;
    gsize length;
    if (argc != 3) {
        fprintf(stderr, "usage: bsdf_values FILE.bsdf PAIRS\n");
        return EXIT_FAILURE;
    }
    struct rgl *rgl = rgl_read(argv[1], &error);
    if (!rgl || !g_file_get_contents(argv[2], &bytes, &length, &error)) {
        fprintf(stderr, "%s\n", error->message);
        rgl_free(rgl);
        return EXIT_FAILURE;
    }
    const float *pairs = (const float *)(gconstpointer)bytes;
    for (gsize i = 0; i < length / (6 * sizeof(float)); i++) {
        float rgb[3];
        rgl_evaluate(rgl, pairs + 6 * i, pairs + 6 * i + 3, rgb);
        fwrite(rgb, sizeof rgb, 1, stdout);
    }
    rgl_free(rgl);
    return fflush(stdout) == 0 ? EXIT_SUCCESS : EXIT_FAILURE;
}
