/* Sessions of the simulated world, resampled, against its own truth of cameras and lamps that are
 * far away. “--verbose” prints docs/research/accuracy.md's table. */
#include "lib/near_field_fixture.h"

#include "lib/ok.h"
#include "lib/test.h"
#include "lib/world_fixture.h"
#include "world/truth.h"

/* A simulated sample as a rig's cameras and lamps see it, and as far away ones do: views and lights
 * are those of twelve(), by turning table and arc. */
static World *traced_world(const char *name, const char *sample, double camera_mm, double lamp_mm) {
    g_autoptr(GString) text = g_string_new("[world]\nnoise=no\ngather_rays=0\n");
    for (int i = 1; i <= 5; i++)
        g_string_append_printf(text,
                               "[camera c%d]\ntheta_deg=%d\ndistance_mm=%g\n"
                               "[lamp l%d]\ntheta_deg=%d\ndistance_mm=%g\n",
                               i, 15 * i, camera_mm, i, 15 * i, lamp_mm);
    g_string_append_printf(text, "[sample]\nwidth_mm=60\nheight_mm=60\n%s\n", sample);
    g_autofree char *path = world_fixture_write(name, text->str);
    World *world = ok(world_get(path, ERR));
    return world;
}

static void trace(World *world, const struct rings *views, const struct rings *lights, int view,
                  int light, double level_mm, float *ret_rgb) {
    const struct truth_grid grid = {SIDE, SIDE, SIDE_MM, SIDE_MM, level_mm};
    const double turntable_deg = -(double)views->phi[view];
    truth_btf(world, view / 12, light / 12, turntable_deg,
              (double)lights->phi[light] + turntable_deg, &grid, 2, ret_rgb);
}

static struct {
    World *world;
    const struct rings *views, *lights;
} near_world;

/* What the simulator says instead of the formula, and where it has its devices. */
static gboolean trace_part(struct exr_part *part, int view, int light) {
    const double turntable_deg = -(double)near_world.views->phi[view];
    double camera[3], lamp[3];
    float rgb[3 * ALL];
    trace(near_world.world, near_world.views, near_world.lights, view, light, LEVEL_MM, rgb);
    for (int k = 0; k < 3 * ALL; k++)
        part->planes[2 - k % 3][k / 3] = rgb[k];
    truth_view_centre_mm(near_world.world, view / 12, turntable_deg, camera);
    truth_lamp(near_world.world, light / 12, (double)near_world.lights->phi[light], lamp, NULL);
    exr_set_v3d(part, "view.centre_mm", camera[0], camera[1], camera[2]);
    exr_set_v3d(part, "light.position_mm", lamp[0], lamp[1], lamp[2]);
    return TRUE;
}

static void add_traced(const char *session, World *far_away, const struct rings *views,
                       const struct rings *lights, double ret_error[6], double ret_norm[6]) {
    for (int view = 0; view < views->n; view++) {
        struct exr_file *file = near_field_read_view(session, view);
        for (int light = 0; light < lights->n; light++) {
            const struct exr_part *part = g_ptr_array_index(file->parts, (guint)light);
            float rgb[3 * ALL];
            trace(far_away, views, lights, view, light, LEVEL_MM, rgb);
            for (int k = 0; k < 3 * ALL; k++) {
                const double off = (double)(part->planes[2 - k % 3][k / 3] - rgb[k]);
                ret_error[view / 12] += off * off;
                ret_norm[view / 12] += (double)rgb[k] * (double)rgb[k];
                ret_error[5] += off * off;
                ret_norm[5] += (double)rgb[k] * (double)rgb[k];
            }
        }
        exr_file_free(file);
    }
}

/* Against the simulated world's own truth of far away cameras and lamps. better: by how much the
 * error must shrink. */
static void trace_sample(const char *name, const char *sample, double better) {
    const struct rings views = near_field_twelve(0), lights = near_field_twelve(15);
    const struct wish wish = {.nowhere = TRUE, .spoil = trace_part};
    g_autofree char *to_name = g_strconcat(name, "-to", NULL);
    double before[6] = {0}, after[6] = {0}, norm[6] = {0};
    struct near_field_correction_result result;
    g_autoptr(World) near = traced_world("near.conf", sample, CAMERA_MM, LAMP_MM);
    near_world.world = near;
    near_world.views = &views;
    near_world.lights = &lights;
    g_autofree char *from = near_field_make_session(name, &views, &lights, &wish);
    g_autofree char *to = near_field_resample(from, to_name, NULL, &result);
    g_autoptr(World) far_away = traced_world("far.conf", sample, 10000, 10000);
    add_traced(from, far_away, &views, &lights, before, norm);
    memset(norm, 0, sizeof norm);
    add_traced(to, far_away, &views, &lights, after, norm);
    for (int k = 0; k < 6; k++)
        g_test_message("%s, %d degrees: read as nominal %.2f %%, resampled %.2f %%", name,
                       15 * (k + 1), 100 * sqrt(before[k] / norm[k]),
                       100 * sqrt(after[k] / norm[k]));
    g_test_message("%s: said: back %.2f %%, left out %.2f and %.2f %%", name, 100 * result.all.back,
                   100 * result.all.left_out_view, 100 * result.all.left_out_light);
    g_assert_cmpfloat(after[5], <, before[5] / (better * better));
    near_field_correction_result_clear(&result);
}

TEST(traced_diffuse) {
    trace_sample("diffuse", "kind=flat\ngrid=2\nbase_mm=4.98", 4);
}

/* The truth has no noise, and 10 m leave it about 0.2 %. At 75° silk's highlight is narrower than
 * directions are apart, so that interpolation limits what can be won: 1.81 times when this was
 * written. The bound keeps that from getting worse and claims no more. */
TEST(traced_silk) {
    trace_sample("silk",
                 "kind=flat\ngrid=2\nbase_mm=4.98\nalbedo=0.3\ngloss=0.2\nroughness_along=0.4\n"
                 "roughness_across=0.3",
                 1.7);
}

BEFORE_TESTS {
    near_folder = g_dir_make_tmp("btf-resample-XXXXXX", NULL);
}

AFTER_TESTS {
    world_fixture_clean();
    remove_tree(near_folder);
    g_free(near_folder);
}
