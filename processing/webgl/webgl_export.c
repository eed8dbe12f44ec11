#include "webgl_export.h"

#include "base/data_error.h"
#include "base/output_file.h"
#include "webgl_pack.h"
#include "webgl_page.h"
#include "webgl_source.h"

#define HEADER 4096 /* maximum number of bytes of the header of a material's file */

static gboolean is_page(const char *output) {
    g_autofree char *lower = g_ascii_strdown(output, -1);
    return g_str_has_suffix(lower, ".html");
}

static gint64 output_bytes(const struct webgl_export *asked, const struct webgl_pack *pack, int n) {
    const gint64 bytes = webgl_pack_bytes(pack, n) + HEADER;
    return is_page(asked->output) ? webgl_page_bytes(bytes) : bytes;
}

/* Returns n of the finest grid with which the output fits into the size even if its sections do not
 * compress at all. If the local PCA is already on a grid, only this grid is tried. Returns 0 with
 * an error if no grid fits. */
static int grid(const struct webgl_export *asked, const struct webgl_pack *pack, GError **error) {
    const int own = pack->levels[0]->n_grid;
    gint64 bytes = 0;
    for (int n = own > 0 ? own : WEBGL_PACK_GRID_MAX; n >= WEBGL_PACK_GRID_MIN; n--) {
        bytes = output_bytes(asked, pack, n);
        if (bytes <= asked->size)
            return n;
        if (own > 0)
            break;
    }
    g_autofree char *least = g_format_size((guint64)bytes);
    g_autofree char *limit = g_format_size((guint64)asked->size);
    const struct btf_layout *layout = &pack->levels[0]->layout;
    data_error_set(asked->path, 0, error,
                   "%zu × %zu texels in %d clusters of %d components take %s, but --size allows "
                   "%s; give a larger --size, or export a file that “mesorig compress” made with "
                   "fewer clusters and components%s",
                   layout->width, layout->height, pack->levels[0]->n_clusters,
                   pack->levels[0]->n_components, least, limit,
                   own > 0 ? " or a coarser --grid" : "");
    return 0;
}

/* Returns FALSE with an error if neural planes do not fit into the size. */
static gboolean check_neural(const struct webgl_export *asked, const struct webgl_pack *pack,
                             GError **error) {
    const gint64 bytes = output_bytes(asked, pack, 0);
    g_autofree char *needed = g_format_size((guint64)bytes);
    g_autofree char *limit = g_format_size((guint64)asked->size);
    const struct btf_layout *layout = &pack->neural->layout;
    return bytes <= asked->size ||
           data_error_fail(asked->path, 0, error,
                           "%zu × %zu texels of %d channels take up to %s, but --size allows %s; "
                           "give a larger --size, or export a file that “mesorig compress” made "
                           "with fewer --components",
                           layout->width, layout->height, pack->neural->n_channels, needed, limit);
}

static gboolean webgl_export_source(const struct webgl_export *asked,
                                    const struct webgl_source *source, const struct work *work,
                                    struct webgl_export_result *ret, GError **error) {
    const struct lpca *lpca = source->levels[0];
    const struct neural *neural = source->neural;
    const struct btf_layout *layout = neural ? &neural->layout : &lpca->layout;
    const char *name = neural ? neural->name : lpca->name;
    g_autofree char *base = g_path_get_basename(asked->path);
    const struct webgl_pack pack = {name && *name ? name : base,
                                    source->levels,
                                    source->n_levels,
                                    source->shell,
                                    source->views,
                                    neural};
    const int n = neural ? 0 : grid(asked, &pack, error);
    const gboolean fits = neural ? check_neural(asked, &pack, error) : n > 0;
    g_autoptr(GBytes) material = fits ? webgl_pack(&pack, n, work, error) : NULL;
    if (!material)
        return FALSE;
    g_autoptr(GBytes) output =
        is_page(asked->output) ? webgl_page(pack.name, material) : g_bytes_ref(material);
    *ret = (struct webgl_export_result){.width = (int)layout->width,
                                        .height = (int)layout->height,
                                        .clusters = neural ? 0 : lpca->n_clusters,
                                        .components = neural ? 0 : lpca->n_components,
                                        .channels = neural ? neural->n_channels : 0,
                                        .levels = source->n_levels,
                                        .grid = n,
                                        .shell = source->shell != NULL,
                                        .compressed = source->compressed,
                                        .bytes = (gint64)g_bytes_get_size(output)};
    return output_file_write(asked->output, g_bytes_get_data(output, NULL),
                             g_bytes_get_size(output), error);
}

gboolean webgl_export(const struct webgl_export *asked, const struct work *work,
                      struct webgl_export_result *ret, GError **error) {
    struct webgl_source source;
    const gboolean ok = webgl_source_open(&source, asked->path, asked->mdf, work, error) &&
                        webgl_export_source(asked, &source, work, ret, error);
    webgl_source_clear(&source);
    return ok;
}
