#include "measurement_rig.h"

#include "exr/exr.h"

#include <glib/gstdio.h>
#include <math.h>
#include <unistd.h>

#define RAD(deg)     ((deg) * (G_PI / 180))
#define CAMERA_MM    650.0
#define LAMP_MM      500.0
#define LASER_MM     480.0
#define REFERENCE_MM 5.0
#define DEPTH_MM     5.0
#define SAMPLE_MM    75.0
#define K1           (-0.02)
#define VIGNETTING   0.06
#define RESPONSE     6000.0
#define INTENSITY    40.0

struct picture {
    double focal_px;
    int width, height;
};

double bench_elevation_deg(int index) {
    return 15 * (index + 1);
}

/* Holds the sample as far as its deepest places, and a margin. */
static struct picture picture_of(const struct bench_setup *setup, int camera) {
    double theta = RAD(bench_elevation_deg(camera)),
           side = G_SQRT2 * setup->texels * setup->texel_mm;
    double shortened = setup->keep_focal ? 1 : cos(theta);
    double focal = setup->pixels_a_texel * CAMERA_MM / (setup->texel_mm * shortened);
    double a_mm = focal / (CAMERA_MM - side / 2 * sin(theta) - REFERENCE_MM);
    double tall = side * cos(theta) + 2 * (REFERENCE_MM + DEPTH_MM) * sin(theta);
    return (struct picture){focal, (int)(side * a_mm) / 2 * 2 + 16,
                            (int)(tall * a_mm) / 2 * 2 + 16};
}

static char *world_text(const struct bench_setup *setup) {
    GString *text = g_string_new(NULL);
    g_string_append_printf(text,
                           "[world]\nseed = 7\nnoise = %s\nsupersample = %d\ngather_rays = %d\n"
                           "cache_mb = 400\nwarm_up_s = 0\n"
                           "[sample]\nkind = %s\nseed = 3\nwidth_mm = %g\nheight_mm = %g\n"
                           "base_mm = 0.8\nrelief_mm = %g\ntop_mm = %g\nperiod_mm = 6.25\n",
                           setup->noise ? "yes" : "no", setup->supersample, setup->gather_rays,
                           setup->material, SAMPLE_MM, SAMPLE_MM,
                           setup->relief_mm > 0                      ? setup->relief_mm
                           : g_str_equal(setup->material, "brushed") ? 0.3
                           : g_str_equal(setup->material, "peanuts") ? 3.6
                           : g_str_equal(setup->material, "brick")   ? 2.0
                                                                     : 1.2,
                           REFERENCE_MM);
    for (int i = 0; i < RIG_VIEWS; i++) {
        struct picture picture = picture_of(setup, i);
        g_string_append_printf(
            text,
            "[camera cam%d]\ntheta_deg = %g\ndistance_mm = %g\nwidth = %d\nheight = %d\n"
            "focal_px = %.17g\nresponse = %g\nvignetting = %g\nk1 = %g\ncfa = %s\n",
            i, bench_elevation_deg(i), CAMERA_MM, picture.width, picture.height, picture.focal_px,
            RESPONSE, VIGNETTING, K1, setup->mono ? "mono" : "rggb");
    }
    for (int i = 0; i < RIG_VIEWS; i++)
        g_string_append_printf(text,
                               "[lamp lamp%d]\ntheta_deg = %g\ndistance_mm = %g\nexponent = 2\n"
                               "intensity = %g\n[laser laser%d]\ntheta_deg = %g\ndistance_mm = %g\n"
                               "width_mm = 1.2\nfan_deg = 20\npower_w = 0.02\n",
                               i, bench_elevation_deg(i), LAMP_MM, INTENSITY, i,
                               bench_elevation_deg(i), LASER_MM);
    return g_string_free(text, FALSE);
}

World *bench_world(const struct bench_setup *setup, GError **error) {
    g_autofree char *path = NULL, *text = world_text(setup);
    int file = g_file_open_tmp("mesorig-bench-XXXXXX.conf", &path, error);
    if (file < 0)
        return NULL;
    close(file);
    World *world = g_file_set_contents(path, text, -1, error) ? world_get(path, error) : NULL;
    g_unlink(path);
    return world;
}

void bench_rig(const struct bench_setup *setup, struct rig *ret) {
    *ret = (struct rig){
        .id = "bench", .n_cameras = RIG_VIEWS, .n_lamps = RIG_VIEWS, .n_lasers = RIG_VIEWS};
    for (int i = 0; i < RIG_VIEWS; i++) {
        struct vec3 out = rig_direction(RAD(bench_elevation_deg(i)), 0), in = vec3_scale(out, -1);
        struct picture picture = picture_of(setup, i);
        struct rig_camera *camera = &ret->cameras[i];
        *camera = (struct rig_camera){.width = picture.width,
                                      .height = picture.height,
                                      .fx_px = picture.focal_px,
                                      .fy_px = picture.focal_px,
                                      .cx_px = (picture.width - 1) / 2.0,
                                      .cy_px = (picture.height - 1) / 2.0,
                                      .k1 = K1,
                                      .vignetting = VIGNETTING,
                                      .response = RESPONSE};
        rig_camera_look_at(camera, vec3_scale(out, CAMERA_MM), vec3(0, 0, 0));
        ret->lamps[i] = (struct rig_lamp){.position_mm = vec3_scale(out, LAMP_MM),
                                          .aim = in,
                                          .exponent = 2,
                                          .intensity = INTENSITY};
        ret->lasers[i] = (struct rig_laser){.position_mm = vec3_scale(out, LASER_MM),
                                            .axis = vec3(0, 1, 0),
                                            .normal = vec3_cross(vec3(0, 1, 0), in)};
        g_snprintf(camera->name, RIG_NAME, "cam%d", i);
        g_snprintf(ret->lamps[i].name, RIG_NAME, "lamp%d", i);
        g_snprintf(ret->lasers[i].name, RIG_NAME, "laser%d", i);
    }
}

struct session_grid bench_grid(const struct bench_setup *setup) {
    double side = setup->texels * setup->texel_mm;
    return (struct session_grid){setup->texels, setup->texels, side, side, REFERENCE_MM, DEPTH_MM};
}

struct truth_grid bench_truth_grid(const struct bench_setup *setup) {
    double side = setup->texels * setup->texel_mm;
    return (struct truth_grid){setup->texels, setup->texels, side, side, REFERENCE_MM};
}

void bench_write_frame(const char *path, const struct rig_camera *camera) {
    static const char *const channels[] = {"Y", NULL};
    struct exr_part *part =
        exr_part_new("radiance", camera->width, camera->height, channels, EXR_HALF);
    struct exr_file *file = exr_file_new();
    GRand *rand = g_rand_new_with_seed(1);
    for (int i = 0; i < camera->width * camera->height; i++)
        part->planes[0][i] = (float)(100 + i % camera->width * 0.5 + g_rand_double(rand) * 4);
    g_rand_free(rand);
    exr_set_string(part, "mesorig.cfa", "rggb");
    exr_file_add(file, part);
    g_assert_true(exr_write(path, file, EXR_PIZ, FALSE, NULL));
    exr_file_free(file);
}
