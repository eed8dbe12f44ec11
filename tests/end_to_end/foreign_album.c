#include "foreign_album.h"

#define BITS  12
#define BLACK 256

const struct pinhole cameras[CAMERAS] = {
    {256, 192, 15 * DEGREE, 650, 1625, 4 * DEGREE, {2.3, -1.7}, -0.3},
    {256, 192, 35 * DEGREE, 655, 1640, -21 * DEGREE, {-3.1, 0.8}, -0.2},
    {256, 192, 55 * DEGREE, 640, 1610, 26 * DEGREE, {0.6, 2.2}, -0.4},
};
const struct arc_lamp lamp = {40 * DEGREE, 500, 400, 1.5};
const double lamp_azimuths_deg[LAMPS] = {20, 110.4, 200, 289.7};
const struct line_laser laser = {45 * DEGREE, 400};
const double laser_azimuths_deg[LASERS] = {60, 240};
const double zero_deg[LASERS] = {0.12, -0.07}, stretch[LASERS] = {0.004, -0.003};

struct album album_begin(const char *folder, const char *name) {
    struct album album = {.dir = g_build_filename(folder, name, NULL),
                          .sensor = {FULL_WELL, READ_NOISE, g_str_hash(name)}};
    g_assert_cmpint(g_mkdir_with_parents(album.dir, 0777), ==, 0);
    album.rows = g_string_new(
        "file,camera,lamp,laser,turntable_deg,sweep_deg,exposure_ms,bits,black_level\n");
    return album;
}

void album_end(struct album *album) {
    g_autofree char *path = g_build_filename(album->dir, "poses.csv", NULL);
    g_assert_true(g_file_set_contents(path, album->rows->str, -1, NULL));
    g_string_free(album->rows, TRUE);
    g_free(album->dir);
}

/* planes: n_planes × pixels, shares of white, which get noise. */
static void album_write(struct album *album, const char *name, float *planes, int n_planes) {
    const int n = cameras[0].width * cameras[0].height, white = (1 << BITS) - 1;
    g_autofree char *path = g_build_filename(album->dir, name, NULL);
    g_autofree guint16 *codes = g_new(guint16, n_planes * n);
    foreign_expose(&album->sensor, planes, (gsize)n_planes * (gsize)n);
    for (int i = 0; i < n_planes * n; i++)
        codes[i] = (guint16)lround(
            MAX(BLACK + (double)planes[i % n_planes * n + i / n_planes] * (white - BLACK), 0));
    foreign_write_png(path, codes, cameras[0].width, cameras[0].height, n_planes, 16);
}

void album_lamps(struct album *album, const struct foreign_scene *scene, const struct look *look,
                 double turntable_deg) {
    const int n = cameras[0].width * cameras[0].height;
    for (int i = 0; i < look->n_cameras * look->n_lamps; i++) {
        const int c = i / look->n_lamps, l = i % look->n_lamps;
        const struct foreign_shot shot = {&cameras[c],
                                          &lamp,
                                          lamp_azimuths_deg[l] * DEGREE,
                                          turntable_deg * DEGREE,
                                          look->exposure_ms,
                                          look->n_spots,
                                          look->fine_mm};
        g_autofree float *planes = foreign_render(scene, &shot);
        g_autofree char *name = g_strdup_printf("t%03.0f_cam%d_lamp%d.png", turntable_deg, c, l);
        album_write(album, name, planes + (look->grey ? n : 0), look->grey ? 1 : 3);
        g_string_append_printf(album->rows, "%s,cam%d,lamp%d,,%g,,%g,%d,%d\n", name, c, l,
                               turntable_deg, look->exposure_ms, BITS, BLACK);
    }
}

void album_sweeps(struct album *album, const struct foreign_scene *scene, int n_cameras,
                  double turntable_deg, double reach_deg, double fine_mm) {
    const int n = cameras[0].width * cameras[0].height;
    const double step_deg = 2 * reach_deg / (STEPS - 1);
    for (int i = 0; i < n_cameras * LASERS; i++) {
        const int c = i / LASERS, k = i % LASERS;
        const struct foreign_sweep sweep = {
            .camera = &cameras[c],
            .laser = &laser,
            .arc = laser_azimuths_deg[k] * DEGREE,
            .turntable = turntable_deg * DEGREE,
            .from_rad = (zero_deg[k] - (1 + stretch[k]) * reach_deg) * DEGREE,
            .step_rad = (1 + stretch[k]) * step_deg * DEGREE,
            .steps = STEPS,
            .sigma_rad = step_deg * DEGREE,
            .peak = 0.9,
            .samples = 3,
            .fine_mm = fine_mm};
        g_autofree float *frames = foreign_render_sweep(scene, &sweep);
        for (int f = 0; f < STEPS; f++) {
            g_autofree char *name =
                g_strdup_printf("t%03.0f_cam%d_laser%d_%02d.png", turntable_deg, c, k, f);
            album_write(album, name, frames + (gsize)f * (gsize)n, 1);
            g_string_append_printf(album->rows, "%s,cam%d,,laser%d,%g,%.5f,1,%d,%d\n", name, c, k,
                                   turntable_deg, -reach_deg + f * step_deg, BITS, BLACK);
        }
    }
}
