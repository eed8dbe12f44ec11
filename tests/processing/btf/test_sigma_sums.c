/* Which pictures btf_sigma_sum() calls worse than the others: only those that differ from others at
 * the same polar angles. */
#include "btf/btf_sigma.h"
#include "lib/folder.h"
#include "lib/ok.h"
#include "lib/test.h"

#include <glib/gstdio.h>

#define VIEWS  2 /* at 15° and at 75° */
#define LIGHTS 8 /* at one polar angle */
#define USUAL  0.1
#define STEEP  0.4 /* of the view at 75°, more than twice USUAL */

BEFORE_TESTS {
    folder_make();
}

AFTER_TESTS {
    folder_remove();
}

/* sigma.relative of a view and a light. */
typedef double (*Relative)(int view, int light);

static void add_picture(struct exr_file *file, int view, int light, int n_lights, double relative,
                        gboolean predicted) {
    static const char *const channels[] = {"R", NULL};
    g_autofree char *name = g_strdup_printf("light_%04d", light);
    struct exr_part *part = exr_part_new(name, 1, 1, channels, EXR_HALF);
    exr_set_v3d(part, "sigma.colour", 1, 1, 1);
    exr_set_v3d(part, "sigma.scale", 0, 0, 0);
    exr_set_double(part, "sigma.rms", 0.01);
    exr_set_double(part, "sigma.value", 0.1);
    exr_set_double(part, "sigma.median", 0.01);
    exr_set_double(part, "sigma.relative", relative);
    exr_set_double(part, "view.theta_deg", view > 0 ? 75 : 15);
    exr_set_double(part, "view.phi_deg", 30);
    exr_set_double(part, "light.theta_deg", 45);
    exr_set_double(part, "light.phi_deg", 360.0 * light / n_lights);
    exr_set_int(part, "mesorig.predicted", predicted);
    exr_file_add(file, part);
}

static struct btf_sigma_sums sum(int n_lights, Relative relative, int predicted) {
    g_autofree char *btf = in_folder("products/btf");
    g_mkdir_with_parents(btf, 0755);
    for (int view = 0; view < VIEWS; view++) {
        g_autofree char *name = g_strdup_printf("view_%04d.exr", view);
        g_autofree char *path = g_build_filename(btf, name, NULL);
        g_autoptr(ExrFile) file = exr_file_new();
        for (int light = 0; light < n_lights; light++)
            add_picture(file, view, light, n_lights, relative(view, light),
                        view == 0 && light == predicted);
        ok(exr_write(path, file, EXR_NONE, FALSE, ERR));
    }
    struct btf_sigma_sums ret;
    btf_sigma_sum(folder, &ret);
    g_assert_cmpint(ret.known, ==, VIEWS * n_lights);
    return ret;
}

static double even(int view, int light) {
    (void)light;
    return view > 0 ? STEEP : USUAL;
}

/* One picture of the flat view is as bad as all of the steep view. */
static double one_bad(int view, int light) {
    return view == 0 && light == 3 ? 0.35 : even(view, light);
}

TEST(steep_view_is_usual) {
    const struct btf_sigma_sums sums = sum(LIGHTS, even, -1);
    g_assert_cmpint(sums.worse, ==, 0);
    g_assert_cmpfloat_with_epsilon(sums.worst, STEEP, 1e-6);
    g_assert_cmpint(sums.large, ==, VIEWS * LIGHTS);
}

TEST(one_picture) {
    const struct btf_sigma_sums sums = sum(LIGHTS, one_bad, -1);
    g_assert_cmpint(sums.worse, ==, 1);
    g_assert_cmpfloat_with_epsilon(sums.worse_relative, 0.35, 1e-6);
    g_assert_cmpfloat(sums.worse_view_theta_deg, ==, 15);
    g_assert_cmpfloat(sums.worse_light_phi_deg, ==, 360.0 * 3 / LIGHTS);
}

TEST(predicted_picture) {
    g_assert_cmpint(sum(LIGHTS, one_bad, 3).worse, ==, 0);
}

static double last_bad(int view, int light) {
    (void)view;
    return light == 3 ? 0.35 : USUAL;
}

/* Four pictures have no median of their own, so that all eight are compared. */
TEST(few_pictures) {
    g_assert_cmpint(sum(4, last_bad, -1).worse, ==, 2);
}
