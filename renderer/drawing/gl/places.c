#include "places.h"

#include "gpu.h"

#include <epoxy/gl.h>
#include <string.h>

enum places_kind places_kind_of(const struct places_source *source) {
    return source->index != NULL     ? PLACES_INDEX
           : source->endless != NULL ? PLACES_ENDLESS
                                     : PLACES_REPEATED;
}

char *places_constants(const struct places_source *source, gboolean nearest) {
    char blend[G_ASCII_DTOSTR_BUF_SIZE];
    const gboolean software =
        strstr(gpu_renderer(), "llvmpipe") || strstr(gpu_renderer(), "softpipe");
    return g_strdup_printf("#define PLACES %d\n#define PLACES_NEAREST %d\n#define PLACES_LEVEL %d\n"
                           "#define ENDLESS_CENTRES %d\n#define ENDLESS_BLEND %s\n",
                           places_kind_of(source), nearest, software, ENDLESS_CENTRES,
                           g_ascii_formatd(blend, sizeof blend, "%.6f", ENDLESS_BLEND));
}

void places_bind(const struct places_source *source, const float tiles[2], guint program) {
    struct endless_lattice lattice;
    if (source->index != NULL)
        index_texture_bind(source->index, program);
    else if (source->endless != NULL) {
        endless_lattice_init(&lattice, source->endless, tiles[0], tiles[1]);
        glUniform2fv(glGetUniformLocation(program, "endless_cells"), 1, lattice.cells);
        glUniform2iv(glGetUniformLocation(program, "endless_period"), 1, lattice.period);
        glUniform2fv(glGetUniformLocation(program, "endless_edge"), 1, source->endless->edge);
        glUniform2fv(glGetUniformLocation(program, "endless_centres"), ENDLESS_CENTRES,
                     source->endless->centres[0]);
    }
}
