#include "maps_store.h"

#include <gio/gio.h>
#include <math.h>
#include <stddef.h>
#include <string.h>

#include "exr/exr.h"
#include "maps_private.h"
#include "session/inputs.h"
#include "session/session.h"

/* Version of the fit and of its errors. A file of another version is not read. */
#define VERSION 8
#define MADE_BY "export maps -o FOLDER"

/* The members of a texel by name, in the order that EXR requires; E comes first. */
static const struct {
    const char *name;
    gsize offset;
} members[] = {
#define MEMBER(NAME, FIELD)                                                                        \
    { NAME, offsetof(struct maps_texel, FIELD) }
    MEMBER("anisotropy", anisotropy),
    MEMBER("base.B", base[2]),
    MEMBER("base.G", base[1]),
    MEMBER("base.R", base[0]),
    MEMBER("coat", coat),
    MEMBER("direction.X", direction[0]),
    MEMBER("direction.Y", direction[1]),
    MEMBER("metallic", metallic),
    MEMBER("normal.X", normal[0]),
    MEMBER("normal.Y", normal[1]),
    MEMBER("normal.Z", normal[2]),
    MEMBER("roughness", roughness),
    MEMBER("sheen.B", sheen[2]),
    MEMBER("sheen.G", sheen[1]),
    MEMBER("sheen.R", sheen[0]),
    MEMBER("specular", specular),
    MEMBER("specular_colour.B", specular_colour[2]),
    MEMBER("specular_colour.G", specular_colour[1]),
    MEMBER("specular_colour.R", specular_colour[0]),
};
#define MEMBERS G_N_ELEMENTS(members)
G_STATIC_ASSERT(MEMBERS * sizeof(float) == sizeof(struct maps_texel));

const char *maps_store_product(enum maps_model model) {
    return model == MAPS_MODEL_CORE ? "products/maps_fit_core.exr" : "products/maps_fit.exr";
}

char *maps_store_inputs(const char *session, enum maps_model model, GError **error) {
    g_autoptr(Session) opened = session_open(session, SESSION_READ, error);
    g_autoptr(GPtrArray) files = opened ? session_btf_files(opened, error) : NULL;
    g_autoptr(GPtrArray) products = files ? session_list_products(opened, error) : NULL;
    if (!products)
        return NULL;
    g_autoptr(GChecksum) sum = g_checksum_new(G_CHECKSUM_SHA256);
    guint n = 0;
    input_hash(sum, "maps %d%s", VERSION, model == MAPS_MODEL_CORE ? " core" : "");
    for (guint i = 0; i < products->len; i++) {
        const struct session_product *product = products->pdata[i];
        if (!g_str_has_prefix(product->path, "products/btf/"))
            continue;
        input_hash(sum, "%s %s", product->path, product->sha256);
        n++;
    }
    return n == files->len ? g_strdup(g_checksum_get_string(sum)) : NULL;
}

/* Reads every number of struct maps from a part. Returns FALSE if one is missing. */
static gboolean numbers(const struct exr_part *part, struct maps *maps, double ret_layers[2]) {
    int holes = 0;
    const gboolean ok =
        exr_get_int(part, "n_views", &maps->n_views, NULL) &&
        exr_get_int(part, "n_lights", &maps->n_lights, NULL) &&
        exr_get_int(part, "dark", &maps->fit->dark, NULL) &&
        exr_get_int(part, "holes", &holes, NULL) &&
        exr_get_int(part, "errors_every", &maps->errors.every, NULL) &&
        exr_get_double(part, "texel_mm", &maps->texel_mm, NULL) &&
        exr_get_double(part, "depth_mm", &maps->depth_mm, NULL) &&
        exr_get_double(part, "delta_e", &maps->errors.delta_e, NULL) &&
        exr_get_double(part, "relative_error", &maps->errors.relative_error, NULL) &&
        exr_get_double(part, "sheen_roughness", &ret_layers[0], NULL) &&
        exr_get_double(part, "coat_roughness", &ret_layers[1], NULL);
    maps->holes = holes;
    maps->errors.n_views = maps->n_views;
    maps->errors.n_lights = maps->n_lights;
    return ok;
}

struct maps *maps_store_read(const char *session, enum maps_model model, const char *inputs) {
    g_autofree char *path = g_build_filename(session, maps_store_product(model), NULL);
    const char *name = NULL, *of = NULL;
    double layers[2] = {0};
    if (!g_file_test(path, G_FILE_TEST_IS_REGULAR) || !session_check_product(path, NULL))
        return NULL;
    g_autoptr(ExrFile) file = exr_read(path, NULL);
    const struct exr_part *texels = file ? exr_file_part(file, "texels") : NULL;
    const struct exr_part *pairs = file ? exr_file_part(file, "pairs") : NULL;
    if (!texels || !pairs || !exr_get_string(texels, "mesorig.inputs", &of, NULL) ||
        !g_str_equal(of, inputs) || !exr_get_string(texels, "material", &name, NULL))
        return NULL;
    const gsize n = (gsize)texels->width * (gsize)texels->height;
    g_autoptr(Maps) maps = g_new0(struct maps, 1);
    maps->fit = g_new0(struct maps_fit, 1);
    maps->name = g_strdup(name);
    maps->model = model;
    maps->width = texels->width;
    maps->height = texels->height;
    if (n > MAPS_MAX_TEXELS || !numbers(texels, maps, layers) || pairs->width != maps->n_lights ||
        pairs->height != maps->n_views)
        return NULL;
    maps->fit->layers = maps_layers_new(layers[0], layers[1]);
    maps->fit->texels = g_new0(struct maps_texel, n);
    for (gsize k = 0; k < MEMBERS; k++) {
        const float *plane = exr_part_plane(texels, members[k].name);
        if (!plane || !exr_all_finite(plane, n))
            return NULL;
        for (gsize i = 0; i < n; i++)
            G_STRUCT_MEMBER(float, &maps->fit->texels[i], members[k].offset) = plane[i];
    }
    const float *by_texel = exr_part_plane(texels, "E"), *by_pair = exr_part_plane(pairs, "E");
    if (!by_texel || !by_pair)
        return NULL;
    maps->errors.texels = g_memdup2(by_texel, sizeof(float) * n);
    maps->errors.pairs =
        g_memdup2(by_pair, sizeof(float) * (gsize)pairs->width * (gsize)pairs->height);
    return g_steal_pointer(&maps);
}

static struct exr_part *maps_store_texels(const char *inputs, const struct maps *maps) {
    const gsize n = (gsize)maps->width * (gsize)maps->height;
    const char *channels[MEMBERS + 2] = {"E"};
    for (gsize k = 0; k < MEMBERS; k++)
        channels[k + 1] = members[k].name;
    struct exr_part *ret = exr_part_new("texels", maps->width, maps->height, channels, EXR_FLOAT);
    memcpy(exr_part_plane(ret, "E"), maps->errors.texels, sizeof(float) * n);
    for (gsize k = 0; k < MEMBERS; k++) {
        float *plane = exr_part_plane(ret, members[k].name);
        for (gsize i = 0; i < n; i++)
            plane[i] = G_STRUCT_MEMBER(float, &maps->fit->texels[i], members[k].offset);
    }
    exr_set_string(ret, "mesorig.inputs", inputs);
    exr_set_string(ret, "material", maps->name);
    exr_set_int(ret, "n_views", maps->n_views);
    exr_set_int(ret, "n_lights", maps->n_lights);
    exr_set_int(ret, "dark", maps->fit->dark);
    exr_set_int(ret, "holes", (int)MIN(maps->holes, G_MAXINT));
    exr_set_int(ret, "errors_every", maps->errors.every);
    exr_set_double(ret, "texel_mm", maps->texel_mm);
    exr_set_double(ret, "depth_mm", maps->depth_mm);
    exr_set_double(ret, "delta_e", maps->errors.delta_e);
    exr_set_double(ret, "relative_error", maps->errors.relative_error);
    exr_set_double(ret, "sheen_roughness", (double)maps->fit->layers.sheen_roughness);
    exr_set_double(ret, "coat_roughness", (double)maps->fit->layers.coat_roughness);
    return ret;
}

gboolean maps_store_write(const char *session, const char *inputs, const struct maps *maps,
                          GError **error) {
    static const char *const channels[] = {"E", NULL};
    g_autoptr(Session) opened = session_open(session, SESSION_PRODUCTS, error);
    if (!opened)
        return FALSE;
    g_autoptr(ExrFile) file = exr_file_new();
    struct exr_part *pairs =
        exr_part_new("pairs", maps->n_lights, maps->n_views, channels, EXR_FLOAT);
    memcpy(exr_part_plane(pairs, "E"), maps->errors.pairs,
           sizeof(float) * (gsize)maps->n_lights * (gsize)maps->n_views);
    exr_file_add(file, maps_store_texels(inputs, maps));
    exr_file_add(file, pairs);
    const char *product = maps_store_product(maps->model);
    return exr_write_below(session, product, file, EXR_ZIP, TRUE, error) &&
           session_add_product(opened, product, MADE_BY, error);
}
