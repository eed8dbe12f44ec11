#include "material_fixture.h"
#include "lib/ok.h"

#include "session/session.h"

#include <math.h>
#include <string.h>

static struct direction_list material_fixture_rings(int rings, float turn_deg, gboolean with_pole) {
    struct direction_list all = btf_fixture_rings(rings, 66, turn_deg);
    if (with_pole)
        return all;
    struct direction_list ret = direction_list_new(all.n - 1);
    memcpy(ret.theta_deg, all.theta_deg + 1, sizeof(float) * ret.n);
    memcpy(ret.phi_deg, all.phi_deg + 1, sizeof(float) * ret.n);
    direction_list_clear(&all);
    return ret;
}

struct btf_matrix *material_fixture_btf(gboolean with_pole) {
    return material_fixture_sized(MATERIAL_WIDTH, MATERIAL_HEIGHT, 2, with_pole);
}

struct btf_matrix *material_fixture_sized(int width, int height, int rings, gboolean with_pole) {
    struct btf_matrix *btf =
        btf_fixture_of("highlight", width, height, material_fixture_rings(rings, 0, with_pole),
                       material_fixture_rings(rings, 20, with_pole));
    g_autofree float *views = direction_list_vectors(&btf->layout.views);
    g_autofree float *lights = direction_list_vectors(&btf->layout.lights);
    float *to = btf->values;
    for (int texel = 0; texel < width * height; texel++) {
        const int column = texel % width, row = texel / width;
        const double x = 2 * G_PI * column / width, y = 2 * G_PI * row / height;
        for (gsize v = 0; v < btf->layout.views.n; v++)
            for (gsize l = 0; l < btf->layout.lights.n; l++) {
                double half[3], length = 0;
                for (int i = 0; i < 3; i++) {
                    half[i] = views[3 * v + (gsize)i] + lights[3 * l + (gsize)i];
                    length += half[i] * half[i];
                }
                const double lean = half[2] + 0.2 * half[0] * sin(x) + 0.2 * half[1] * sin(y);
                const double shine = 0.5 * pow(MAX(lean / sqrt(length), 0), 24);
                for (int c = 0; c < 3; c++)
                    *to++ = (float)((0.4 + 0.1 * c * sin(x + c)) * lights[3 * l + 2] + shine);
            }
    }
    return btf;
}

void material_fixture_write(const char *path, const struct codec *codec,
                            const struct btf_matrix *btf, const char *options) {
    static const struct work quiet;
    g_autoptr(GError) error = NULL;
    g_autofree gpointer target = g_malloc0(codec->options_size);
    options_defaults(codec->options, target);
    g_auto(GStrv) all = g_strsplit(options, " ", -1);
    for (gsize i = 0; all[i]; i++) {
        char *value = strchr(all[i], '=');
        if (!value)
            continue;
        *value++ = '\0';
        const struct option *option = options_find(codec->options, all[i]);
        g_assert_nonnull(option);
        g_assert_true(options_set(option, value, target, &error));
    }
    const struct codec_job job = {.btf = btf, .options = target, .work = &quiet};
    struct codec_result result = {0};
    g_assert_true(ok(codec->encode(codec, &job, &result, ERR)));
    g_assert_true(ok(codec->write(path, result.levels->pdata, (int)result.levels->len, ERR)));
    g_ptr_array_unref(result.levels);
}

static void material_fixture_write_views(const char *folder, const struct btf_matrix *btf) {
    static const char *const channels[] = {"B", "G", "R", NULL};
    const struct direction_list *views = &btf->layout.views, *lights = &btf->layout.lights;
    const gsize texels = btf_layout_texels(&btf->layout);
    g_assert_cmpint(g_mkdir_with_parents(folder, 0755), ==, 0);
    for (gsize v = 0; v < views->n; v++) {
        g_autofree char *path = g_strdup_printf("%s/view_%04zu.exr", folder, v);
        g_autoptr(ExrFile) file = exr_file_new();
        for (gsize l = 0; l < lights->n; l++) {
            g_autofree char *name = g_strdup_printf("light_%04zu", l);
            struct exr_part *part =
                exr_part_new(name, MATERIAL_WIDTH, MATERIAL_HEIGHT, channels, EXR_FLOAT);
            exr_set_double(part, "view.theta_deg", (double)views->theta_deg[v]);
            exr_set_double(part, "view.phi_deg", (double)views->phi_deg[v]);
            exr_set_double(part, "light.theta_deg", (double)lights->theta_deg[l]);
            exr_set_double(part, "light.phi_deg", (double)lights->phi_deg[l]);
            btf_layout_write_sizes(&btf->layout, part);
            for (gsize k = 0; k < texels; k++)
                for (gsize c = 0; c < 3; c++)
                    part->planes[2 - c][k] =
                        btf->values[((k * views->n + v) * lights->n + l) * 3 + c];
            exr_file_add(file, part);
        }
        g_assert_true(ok(exr_write(path, file, EXR_NONE, FALSE, ERR)));
    }
}

static struct session_direction *material_fixture_directions(const struct direction_list *list) {
    struct session_direction *ret = g_new0(struct session_direction, list->n);
    for (gsize i = 0; i < list->n; i++)
        ret[i] = (struct session_direction){.index = (int)i,
                                            .theta_deg = (double)list->theta_deg[i],
                                            .phi_deg = (double)list->phi_deg[i]};
    return ret;
}

void material_fixture_write_session(const char *path, const struct btf_matrix *btf) {
    static const struct session_texts texts = {
        .rig_conf = "", .session_conf = "", .calibration = "", .rig_path = "/etc/mesorig/rig.conf"};
    const struct btf_layout *layout = &btf->layout;
    g_autofree struct session_direction *views = material_fixture_directions(&layout->views);
    g_autofree struct session_direction *lights = material_fixture_directions(&layout->lights);
    const struct session_plan plan = {.grid = {.width = MATERIAL_WIDTH,
                                               .height = MATERIAL_HEIGHT,
                                               .width_mm = MATERIAL_WIDTH * layout->texel_mm,
                                               .height_mm = MATERIAL_HEIGHT * layout->texel_mm,
                                               .reference_mm = layout->reference_mm},
                                      .views = views,
                                      .lights = lights,
                                      .n_views = (int)layout->views.n,
                                      .n_lights = (int)layout->lights.n};
    g_autofree char *folder = g_build_filename(path, "products", "btf", NULL);
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_create(path, btf->name, &texts, &plan, &error);
    g_assert_no_error(error);
    material_fixture_write_views(folder, btf);
    for (gsize v = 0; v < layout->views.n; v++) {
        g_autofree char *view = g_strdup_printf("products/btf/view_%04zu.exr", v);
        g_assert_true(ok(session_add_product(session, view, "process", ERR)));
    }
}
