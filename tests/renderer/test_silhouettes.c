/* Silhouettes and shadows of a material's structure: against closed forms, and against displaced
 * geometry that is ray traced. */
#include "base/direction.h"
#include "lib/mdf_copy.h"
#include "lib/mdf_file.h"
#include "lib/ok.h"
#include "lib/silhouettes_fixture.h"
#include "lib/test.h"
#include "lib/view_picture.h"
#include "shapes/mesh_shape.h"

#include <string.h>

#define W 320
#define H 240

static float *see(Viewer *view, const struct viewer_settings *s, int width, int height) {
    float *seen = ok(viewer_render_geometry(view, s, VIEWER_GEOMETRY_LIT, width, height, ERR));
    return seen;
}

/* Rings of views at which a flat structure lies depth_mm deep. */
static struct mdf_table *flat_mdf(int n, double depth_mm) {
    struct mdf_table *t = g_new0(struct mdf_table, 1);
    *t = (struct mdf_table){.width = n, .height = n, .n_views = 24, .texel_mm = 50.0 / n};
    t->theta_deg = g_new(float, 24);
    t->phi_deg = g_new(float, 24);
    t->depth_mm = g_new(float, 24 * n * n);
    t->deepest_mm = depth_mm;
    for (int k = 0; k < 24; k++) {
        t->theta_deg[k] = k < 12 ? 40.0f : 75.0f;
        t->phi_deg[k] = 30.0f * (k % 12);
    }
    for (int k = 0; k < 24 * n * n; k++)
        t->depth_mm[k] = depth_mm;
    return t;
}

TEST(shapes__torus) {
    const double R = 1.0, r = 0.4;
    g_autoptr(Mesh) mesh = scene_torus(R, r, 256, 128);
    g_autofree struct vertex_shape *shapes = mesh_shapes(mesh);
    double mean = 0.0, most = 0.0;
    for (guint k = 0; k < mesh->n_vertices; k++) {
        const struct vertex *v = &mesh->vertices[k];
        double b = 2.0 * G_PI * v->uv[1], around = R + r * cos(b);
        g_assert_cmpfloat_with_epsilon(shapes[k].scale[0], 2.0 * G_PI * around, 0.08);
        g_assert_cmpfloat_with_epsilon(shapes[k].scale[1], 2.0 * G_PI * r, 0.02);
        g_assert_cmpfloat_with_epsilon(shapes[k].bend[0], cos(b) / around, 0.04);
        g_assert_cmpfloat_with_epsilon(shapes[k].bend[1], 0.0, 0.03);
        g_assert_cmpfloat_with_epsilon(shapes[k].bend[2], 1.0 / r, 0.04);
        /* scale[0] is 2π (R + r cos b), and the bitangent has the length r db. */
        const double true_stretch[4] = {0.0, -sin(b) / around, 0.0, 0.0};
        for (int c = 0; c < 4; c++) {
            const double error = fabs((double)shapes[k].stretch[c] - true_stretch[c]);
            mean += error / (4.0 * mesh->n_vertices);
            most = MAX(most, error);
        }
    }
    g_test_message("gradients of scale: mean error %.4f, at most %.4f", mean, most);
    g_assert_cmpfloat(mean, <, 0.01);
    g_assert_cmpfloat(most, <, 0.5); /* at the seams of the texture */
}

/* Triangles without size in space or in the texture leave finite numbers. */
TEST(shapes__degenerate) {
    struct vertex vertices[3] = {{.normal = {0, 0, 1}, .tangent = {1, 0, 0, 1}}};
    guint32 indices[3] = {0, 1, 2};
    struct mesh mesh = {.vertices = vertices, .n_vertices = 3, .indices = indices, .n_indices = 3};
    g_autofree struct vertex_shape *shapes = mesh_shapes(&mesh);
    for (int k = 0; k < 3; k++) {
        g_assert_cmpfloat(shapes[k].scale[0], >, 0.0);
        g_assert_true(isfinite(shapes[k].bend[0]) && isfinite(shapes[k].bend[1]) &&
                      isfinite(shapes[k].bend[2]));
        for (int c = 0; c < 4; c++)
            g_assert_true(isfinite(shapes[k].stretch[c]));
    }
}

/* A structure everywhere h deep makes a sphere smaller by h; how large it looks is known. */
static void check_sphere(double h_mm, enum visibility_way way) {
    g_autoptr(Mesh) mesh = scene_sphere();
    struct mdf_table *mdf = flat_mdf(4, h_mm);
    mesh->tiles_u = 12;
    mesh->tiles_v = 6;
    g_autoptr(Viewer) view = silhouettes_view(mesh, mdf);
    struct viewer_settings s = viewer_settings_default;
    s.camera_distance = 6.0;
    s.camera_fov_deg = 22.0;
    s.silhouettes = TRUE;
    s.visibility.way = way;
    g_autofree float *seen = see(view, &s, W, H);
    double area = 0.0;
    for (int k = 0; k < W * H; k++)
        area += seen[4 * k + 3] > 0.5f;
    /* Tiles are 2π/12 long at the equator; the camera sees where areas are a little smaller. */
    double scale = 2.0 * G_PI / 12.0 / 50.0, focal = 0.5 * H / tan(11.0 * G_PI / 180.0);
    double measured = sqrt(area / G_PI), r[2] = {1.0, 1.0 - h_mm * scale};
    for (int k = 0; k < 2; k++)
        r[k] = focal * tan(asin(r[k] / 6.0));
    g_test_message("radius %.2f pixels, the smooth sphere's is %.2f, the structure's %.2f",
                   measured, r[0], r[1]);
    g_assert_cmpfloat(fabs(measured - r[1]), <, 0.25 * (r[0] - r[1]) + 0.5);
    mdf_table_free(mdf);
}

GPU_TEST(sphere) {
    check_sphere(4.0, VISIBILITY_PEEL);
    check_sphere(8.0, VISIBILITY_AUTO);
}

/* Several tori one behind the other, so that rays enter and leave many times. */
static struct mesh *pile(int n) {
    struct mesh *one = scene_torus(1.0, 0.25, 48, 24), *all = g_new0(struct mesh, 1);
    all->name = g_strdup("pile");
    all->n_vertices = n * one->n_vertices;
    all->n_indices = n * one->n_indices;
    all->vertices = g_new(struct vertex, all->n_vertices);
    all->indices = g_new(guint32, all->n_indices);
    all->radius = 1.5f + 0.35f * n;
    all->tiles_u = 6;
    all->tiles_v = 2;
    for (int k = 0; k < n; k++) {
        for (guint i = 0; i < one->n_vertices; i++) {
            struct vertex *v = &all->vertices[k * one->n_vertices + i];
            *v = one->vertices[i];
            v->position[2] += 0.7f * (k - 0.5f * (n - 1));
        }
        for (guint i = 0; i < one->n_indices; i++)
            all->indices[k * one->n_indices + i] = one->indices[i] + k * one->n_vertices;
    }
    mesh_free(one);
    return all;
}

static int n_seen(const float *seen) {
    int n = 0;
    for (int k = 0; k < W * H; k++)
        n += seen[4 * k + 3] > 0.5f;
    return n;
}

/* Bumps that stand up from a deep ground. */
static struct mdf_table *bumpy_mdf(void) {
    struct mdf_table *t = flat_mdf(8, 6.0);
    for (int k = 0; k < 24 * 64; k++)
        t->depth_mm[k] = k % 8 < 3 && k / 8 % 8 < 4 ? 0.5f : 6.0f;
    return t;
}

GPU_TEST(ways) {
    g_autoptr(Mesh) mesh = pile(5);
    struct mdf_table *mdf = bumpy_mdf();
    g_autoptr(Viewer) view = silhouettes_view(mesh, mdf);
    struct viewer_settings s = viewer_settings_default;
    s.camera_elevation_deg = 12.0;
    s.silhouettes = s.shadows = TRUE;
    s.shadow_size = 256;
    int by_layers = 0;
    for (int straight = 0; straight < 2; straight++)
        for (int layers = 1; layers <= 4; layers += 1 + 2 * (layers == 2)) {
            s.visibility = (struct visibility_options){VISIBILITY_PEEL, layers, straight, FALSE};
            g_autofree float *peeled = see(view, &s, W, H);
            s.visibility.way = VISIBILITY_AUTO;
            g_autofree float *listed = see(view, &s, W, H);
            g_assert_cmpint(silhouettes_differ(peeled, listed, 4 * W * H, 1e-3f), <=,
                            4 * W * H / 20000);
            if (straight == 0 && layers > 1)
                g_assert_cmpint(n_seen(peeled), >, by_layers + 50);
            by_layers = n_seen(peeled);
        }
    mdf_table_free(mdf);
}

/* More faces than there was room for at first, and another size of picture. */
GPU_TEST(lists) {
    if (!gpu_has_43())
        return;
    g_autoptr(Mesh) mesh = pile(8);
    struct mdf_table *mdf = bumpy_mdf();
    g_autoptr(Viewer) view = silhouettes_view(mesh, mdf);
    struct viewer_settings s = viewer_settings_default;
    s.camera_elevation_deg = 1.0;
    s.camera_azimuth_deg = -90.0;
    s.silhouettes = TRUE;
    for (int size = 60; size <= 240; size *= 4) {
        s.camera_distance = 0.9;
        s.visibility.way = VISIBILITY_LISTS;
        g_autofree float *listed = see(view, &s, size, size);
        s.visibility.way = VISIBILITY_PEEL;
        g_autofree float *peeled = see(view, &s, size, size);
        g_assert_cmpint(silhouettes_differ(peeled, listed, 4 * size * size, 1e-3f), <=,
                        size * size / 2000);
    }
    mdf_table_free(mdf);
}

/* Counts points of a picture that face the lamp by at least this cosine, and those of them that its
 * light does not reach. */
static int count_facing(Viewer *view, const struct viewer_settings *s, float least, int *ret_dark) {
    g_autofree float *seen = see(view, s, W, H);
    g_autofree float *light = ok(viewer_render_geometry(view, s, VIEWER_GEOMETRY_LIGHT, W, H, ERR));
    int n = 0;
    *ret_dark = 0;
    for (int k = 0; k < 4 * W * H; k += 4)
        if (seen[k + 3] > 0.5F && light[k + 2] > least) {
            n++;
            *ret_dark += seen[k] < 0.5F;
        }
    return n;
}

/* A structure that is deep everywhere. The BTF has its own shadows, so the lamp reaches all of it
 * that faces the lamp. Where the lamp grazes a curved mesh, chords find the structure elsewhere
 * than along the viewing ray. */
GPU_TEST(lit_structure) {
    static const struct {
        const char *shape;
        float least;
    } shapes[] = {{"plane", 0.1F}, {"cylinder", 0.5F}, {"sphere", 0.7F}};
    struct mdf_table *mdf = flat_mdf(4, 8.0);
    for (gsize k = 0; k < G_N_ELEMENTS(shapes); k++) {
        const struct scene_options scene = {8, 4, SCENE_Z_UP, FALSE};
        g_autoptr(Mesh) mesh = ok(scene_make(shapes[k].shape, &scene, ERR));
        g_autoptr(Viewer) view = silhouettes_view(mesh, mdf);
        struct viewer_settings s = viewer_settings_default;
        s.silhouettes = s.shadows = TRUE;
        s.light_theta_deg = 60.0;
        s.light_phi_deg = s.camera_azimuth_deg + 60.0;
        int dark;
        const int n = count_facing(view, &s, shapes[k].least, &dark);
        g_test_message("%s: %d of %d points that face the lamp are dark", shapes[k].shape, dark, n);
        g_assert_cmpint(n, >, 5000);
        g_assert_cmpint(dark, <=, n / 500);
    }
    mdf_table_free(mdf);
}

#define FINS_MM    20.0 /* depth of the ground between fins, one in each tile of 50 mm */
#define FINS_TILES 7
#define FINS_ROWS  8    /* of the 64 texels along u; a tile is an eighth as high as wide */
#define FIN_HALF   0.04 /* half the thickness of a fin, in tiles */

/* Fins across u, in the middle of each tile, which stand on a deep ground up to the mesh. They are
 * the same along v. */
static struct mdf_table *fins_mdf(void) {
    enum { WIDTH = 64, HEIGHT = FINS_ROWS, RINGS = 17, ROUND = 12 };
    struct mdf_table *t = g_new0(struct mdf_table, 1);
    *t = (struct mdf_table){
        .width = WIDTH, .height = HEIGHT, .n_views = RINGS * ROUND, .texel_mm = 50.0 / WIDTH};
    t->theta_deg = g_new(float, RINGS *ROUND);
    t->phi_deg = g_new(float, RINGS *ROUND);
    t->depth_mm = g_new(float, RINGS *ROUND *WIDTH *HEIGHT);
    t->deepest_mm = FINS_MM;
    for (int k = 0; k < RINGS * ROUND; k++) {
        const double theta = 5.0 * (1 + k / ROUND), phi = 30.0 * (k % ROUND);
        const double slope = tan(theta * G_PI / 180.0) * cos(phi * G_PI / 180.0);
        t->theta_deg[k] = (float)theta;
        t->phi_deg[k] = (float)phi;
        for (int i = 0; i < WIDTH * HEIGHT; i++) {
            /* The next fin in the direction in which the ray descends. */
            double way = 50.0 * (i % WIDTH + 0.5) / WIDTH - 25.0;
            const gboolean fin = fabs(way) < 50.0 * FIN_HALF;
            way = slope > 0.0 ? way : -way;
            way = (way > 0.0 ? way : way + 50.0) - 50.0 * FIN_HALF;
            t->depth_mm[k * WIDTH * HEIGHT + i] =
                fin ? 0.0F : (float)fmin(FINS_MM, way / fmax(fabs(slope), 1e-6));
        }
    }
    return t;
}

/* The distance along a ray into a cylinder with such fins, which point to its axis. The ray enters
 * at u (in tiles); v is the unit vector outwards along it. −1: it meets the ground, a fin's top,
 * nothing, or a fin behind the ray's deepest point. */
static double ray_to_fin(double radius, double ground, double u, const float *v) {
    const double turn = u + 0.5 - floor(u + 0.5); /* from the fin below u */
    const double side = v[0] > 0.0F ? FIN_HALF - turn : 1.0 - FIN_HALF - turn;
    const double angle = 2.0 * G_PI / FINS_TILES * side;
    const double t = radius * sin(angle) / ((double)v[2] * sin(angle) - (double)v[0] * cos(angle));
    const double r = hypot(t * (double)v[0], radius - t * (double)v[2]); /* of the fin's point */
    const gboolean top = turn < FIN_HALF || turn > 1.0 - FIN_HALF;
    const double deepest = radius * (double)v[2] / hypot((double)v[0], (double)v[2]);
    return !top && t > 0.0 && t < deepest && r > ground ? t : -1.0;
}

/* Returns the distance in mm by which a ray into the flat sample misses the point (u, depth_mm).
 * The ray enters at texel, opposite to v. u is in tiles. */
static double flat_miss_mm(const float *texel, const float *v, double u, double depth_mm) {
    const double at = (double)texel[0] - depth_mm * (double)v[0] / (double)v[2] / 50.0 - u;
    return 50.0 * fabs(at - rint(at));
}

/* Deep below a cylinder, a step to the side turns further around its axis than on the mesh. With
 * the shell, the BTF is looked up where the ray ends, with the light as it arrives there. */
static void check_fins(gboolean views) {
    const double radius = 0.6;
    const struct scene_options scene = {FINS_TILES, 3 * 64 / FINS_ROWS, SCENE_Z_UP, FALSE};
    g_autoptr(Mesh) mesh = ok(scene_make("cylinder", &scene, ERR));
    g_autoptr(MdfTable) mdf = fins_mdf();
    g_autoptr(Viewer) view = silhouettes_view(mesh, mdf);
    struct viewer_settings s = viewer_settings_default;
    s.camera_elevation_deg = 0.0;
    s.silhouettes = TRUE;
    s.visibility.views = views;
    g_autofree float *seen = see(view, &s, W, H);
    g_autofree float *end = ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_TEXEL, W, H, ERR));
    g_autofree float *end_v = ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_VIEW, W, H, ERR));
    g_autofree float *end_l =
        ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_LIGHT, W, H, ERR));
    s.visibility.views = TRUE;
    g_autofree float *at = ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_TEXEL, W, H, ERR));
    g_autofree float *v = ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_VIEW, W, H, ERR));
    g_autofree float *l = ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_LIGHT, W, H, ERR));
    const double mm = sqrt(2.0 * G_PI * radius / FINS_TILES * 1.6 / 3.0) / 50.0;
    double sum = 0.0, way = 0.0, miss_mm = 0.0, turned = 0.0;
    int n = 0;
    for (int k = 0; k < 4 * W * H; k += 4) {
        if (seen[k + 3] < 0.5F || at[k + 2] < 0.5F || v[k + 2] < 0.4F)
            continue;
        const double hit = ray_to_fin(radius, radius - FINS_MM * mm, (double)at[k], v + k);
        if (hit < 0.0)
            continue;
        sum += fabs((double)seen[k + 1] - hit);
        way += hit;
        n++;
        const double r = hypot(hit * (double)v[k], radius - hit * (double)v[k + 2]);
        const double side = v[k] > 0.0F ? 0.5 + FIN_HALF : 0.5 - FIN_HALF;
        miss_mm += flat_miss_mm(end + k, end_v + k, side, (radius - r) / mm);
        /* Here the frame turns about the axis of the cylinder. */
        const double angle = asin(-hit * (double)v[k] / r);
        const double x = cos(angle) * (double)l[k] - sin(angle) * (double)l[k + 2];
        turned += fabs((double)end_l[k] - x) + fabs((double)end_l[k + 1] - (double)l[k + 1]);
    }
    g_test_message("the BTF is looked up %.3f mm from the side of a fin; the light is off by %.4f",
                   miss_mm / MAX(n, 1), turned / MAX(n, 1));
    if (!views) {
        g_assert_cmpfloat(miss_mm, <, 0.4 * n);
        g_assert_cmpfloat(turned, <, 0.01 * n);
    }
    g_test_message("%d rays meet fins, after %.4f on average; error %.4f", n, way / MAX(n, 1),
                   sum / MAX(n, 1));
    g_assert_cmpint(n, >, 5000);
    g_assert_cmpfloat(sum, <, (views ? 0.12 : 0.04) * way);
}

GPU_TEST(fins) {
    check_fins(TRUE);
    check_fins(FALSE);
}

/* Texels much smaller than pixels are averaged, along both axes of the texture. A share of them is
 * 6 mm deep, and the others are 0 mm deep. */
static void check_level_of_detail(gboolean views, double share, double least_mm, double most_mm) {
    const struct scene_options scene = {40, 40, SCENE_Z_UP, FALSE};
    g_autoptr(Mesh) mesh = ok(scene_make("plane", &scene, ERR));
    g_autoptr(MdfTable) mdf = flat_mdf(64, 6.0);
    g_autoptr(GRand) random = g_rand_new_with_seed(5);
    for (int k = 0; k < 24; k++)
        mdf->theta_deg[k] *= 0.05F; /* no ray passes through other texels */
    for (int i = 0; i < 64 * 64; i++)
        for (int k = 0, deep = g_rand_double(random) < share; k < 24; k++)
            mdf->depth_mm[k * 64 * 64 + i] = deep ? 6.0F : 0.0F;
    g_autoptr(Viewer) view = silhouettes_view(mesh, mdf);
    struct viewer_settings s = viewer_settings_default;
    s.silhouettes = TRUE;
    s.visibility.views = views;
    g_autofree float *seen = see(view, &s, W, H);
    g_autofree float *v = ok(viewer_render_geometry(view, &s, VIEWER_GEOMETRY_VIEW, W, H, ERR));
    double sum = 0.0, squares = 0.0;
    int n = 0;
    for (int k = 0; k < 4 * W * H; k += 4)
        if (seen[k + 3] > 0.5F) {
            const double depth_mm = (double)seen[k + 1] * (double)v[k + 2] / (2.0 / 40.0 / 50.0);
            sum += depth_mm;
            squares += depth_mm * depth_mm;
            n++;
        }
    const double mean = sum / MAX(n, 1), deviation = sqrt(squares / MAX(n, 1) - mean * mean);
    g_test_message("%d points, %.2f mm deep, standard deviation %.2f mm", n, mean, deviation);
    g_assert_cmpint(n, >, 10000);
    g_assert_cmpfloat(mean, >, least_mm);
    g_assert_cmpfloat(mean, <, most_mm);
    g_assert_cmpfloat(deviation, <, 0.8);
}

/* Distances are averaged. In a shell opacity is averaged, and the ray of a pixel stops at the depth
 * that half of all rays in it reach. */
GPU_TEST(level_of_detail) {
    check_level_of_detail(TRUE, 0.5, 2.8, 3.2);
    check_level_of_detail(FALSE, 0.2, 0.0, 1.0);
}

/* Without structure, silhouettes change nothing. */
GPU_TEST(smooth) {
    g_autoptr(Mesh) mesh = scene_torus(1.0, 0.4, 96, 48);
    struct mdf_table *mdf = flat_mdf(2, 0.0);
    g_autoptr(Viewer) view = silhouettes_view(mesh, mdf);
    struct viewer_settings s = viewer_settings_default;
    g_autofree float *without = ok(viewer_render_linear(view, &s, W, H, ERR));
    s.silhouettes = TRUE;
    g_autofree float *with = ok(viewer_render_linear(view, &s, W, H, ERR));
    g_assert_cmpint(silhouettes_differ(with, without, 4 * W * H, 2e-3f), <=, 4 * W * H / 5000);
    mdf_table_free(mdf);
}

/* A torus above a floor, lit from straight above: its shadow is a ring. */
GPU_TEST(shadow) {
    struct scene_options scene = {8, 3, SCENE_Z_UP, TRUE};
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = scene_make("torus", &scene, &error);
    g_assert_no_error(error);
    g_autoptr(Viewer) view = silhouettes_view(mesh, NULL);
    struct viewer_settings s = viewer_settings_default;
    s.light_theta_deg = 0.0;
    s.camera_elevation_deg = 35.0;
    s.shadows = TRUE;
    viewer_fit(view, &s, (double)W / H);
    struct displaced_camera c = silhouettes_camera(&silhouettes_torus, &s, W, H);
    g_autofree float *seen = see(view, &s, W, H);
    int n = 0, wrong = 0;
    for (int k = 0; k < W * H; k++) {
        int i = k % W, j = k / W;
        double distance = silhouettes_floor_distance(&c, i, j), p[3];
        if (fabs(seen[4 * k + 2] - distance) > 1e-3 * distance)
            continue;
        silhouettes_floor_point(&c, i, j, p);
        double r = hypot(p[0], p[1]);
        if (fabs(r - 0.6) < 0.02 || fabs(r - 1.4) < 0.02)
            continue;
        n++;
        wrong += (seen[4 * k] < 0.5f) != (r > 0.6 && r < 1.4);
    }
    g_assert_cmpint(n, >, 10000);
    g_assert_cmpint(wrong, <=, n / 500);
}

/* The shadow map is kept only as long as nothing changes that it depends on. */
/* The share of a disc of radius 1 that another disc covers. Its radius is r, and the distance
 * between the centres is d. */
static double covered(double r, double d) {
    if (d >= 1.0 + r)
        return 0.0;
    if (d <= fabs(r - 1.0))
        return r >= 1.0 ? 1.0 : r * r;
    const double a = acos((d * d + 1.0 - r * r) / (2.0 * d));
    const double b = acos((d * d + r * r - 1.0) / (2.0 * d * r));
    return (a - sin(2.0 * a) / 2.0 + r * r * (b - sin(2.0 * b) / 2.0)) / G_PI;
}

/* The shadow of a sphere of radius 1 on the floor below it, under a lamp that covers an angle. Seen
 * from the floor, the sphere covers a disc of the sky, which overlaps that of the lamp. */
GPU_TEST(soft_shadow) {
    static const struct silhouettes_shape shape = {"sphere", 1.0, 0, 0, 1.0, 1.0};
    const struct scene_options scene = {12, 6, SCENE_Z_UP, TRUE};
    g_autoptr(Mesh) mesh = ok(scene_make("sphere", &scene, ERR));
    g_autoptr(Viewer) view = silhouettes_view(mesh, NULL);
    struct viewer_settings s = viewer_settings_default;
    s.shadows = TRUE;
    s.light_theta_deg = 35.0;
    s.light_phi_deg = 160.0;
    s.camera_elevation_deg = 60.0;
    viewer_fit(view, &s, (double)W / H);
    double light[3], sum[2] = {0.0};
    float l[3];
    direction_from_deg(s.light_theta_deg, s.light_phi_deg, l);
    for (int c = 0; c < 3; c++)
        light[c] = (double)l[c];
    const struct displaced_camera camera = silhouettes_camera(&shape, &s, W, H);
    int n = 0;
    for (int soft = 0; soft < 2; soft++) {
        const double half = 6.0 * G_PI / 180.0;
        s.light_size_deg = soft ? 12.0 : 0.0;
        g_autofree float *seen = see(view, &s, W, H);
        n = 0;
        for (int k = 0; k < W * H; k++) {
            const float *p = seen + 4 * (gsize)k;
            const double distance = silhouettes_floor_distance(&camera, k % W, k / W);
            double at[3], length = 0.0, along = 0.0;
            silhouettes_floor_point(&camera, k % W, k / W, at);
            for (int c = 0; c < 3; c++) {
                length += at[c] * at[c];
                along -= at[c] * light[c];
            }
            length = sqrt(length);
            const double apart = acos(CLAMP(along / length, -1.0, 1.0));
            const double share = 1.0 - covered(asin(1.0 / length) / half, apart / half);
            if (p[3] < 0.5F || fabs((double)p[2] - distance) > 2e-3 * distance || share < 0.02 ||
                share > 0.98)
                continue;
            sum[soft] += fabs((double)p[0] - share);
            n++;
        }
        sum[soft] /= MAX(n, 1);
    }
    g_test_message("%d points in the half-shadow: light off by %.3f, sharp %.3f", n, sum[1],
                   sum[0]);
    g_assert_cmpint(n, >, 200);
    g_assert_cmpfloat(sum[1], <, 0.07);
    g_assert_cmpfloat(sum[1], <, 0.35 * sum[0]);
}

GPU_TEST(shadow_kept) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Mesh) mesh = pile(3);
    struct mdf_table *bumps = bumpy_mdf(), *flat = flat_mdf(4, 3.0);
    g_autoptr(Viewer) view = silhouettes_view(mesh, bumps);
    struct viewer_settings s = viewer_settings_default;
    s.silhouettes = s.shadows = TRUE;
    g_autofree float *first = see(view, &s, W, H);
    g_autofree float *again = see(view, &s, W, H);
    g_assert_cmpint(silhouettes_differ(first, again, 4 * W * H, 0), ==, 0);
    s.light_phi_deg += 40.0;
    g_autofree float *lit_otherwise = see(view, &s, W, H);
    g_assert_cmpint(silhouettes_differ(first, lit_otherwise, 4 * W * H, 0), >, 0);
    s.light_phi_deg -= 40.0;
    g_assert_true(viewer_set_mdf(view, &(struct mdf_source){.table = flat}, &error));
    g_autofree float *with_flat = see(view, &s, W, H);
    g_assert_cmpint(silhouettes_differ(first, with_flat, 4 * W * H, 0), >, 0);
    g_assert_true(viewer_set_mdf(view, &(struct mdf_source){.table = bumps}, &error));
    g_autofree float *as_before = see(view, &s, W, H);
    g_assert_cmpint(silhouettes_differ(first, as_before, 4 * W * H, 0), ==, 0);
    mesh_free(mesh);
    mesh = pile(2);
    g_assert_true(viewer_set_mesh(view, mesh, &error));
    g_autofree float *other_mesh = see(view, &s, W, H);
    s.shadow_size = 64;
    g_autofree float *coarse = see(view, &s, W, H);
    g_assert_cmpint(silhouettes_differ(other_mesh, coarse, 4 * W * H, 0), >, 0);
    mdf_table_free(bumps);
    mdf_table_free(flat);
}

/* Distances in a volume have 8 bits, and are interpolated between the rings at 40° and 75°. On a
 * plane of one tile, 50 mm are 2 units. Views that are not on rings are refused. */
GPU_TEST(volume) {
    g_autoptr(GError) error = NULL, unlike = NULL;
    g_autoptr(Mesh) mesh = scene_plane();
    g_autoptr(MdfTable) mdf = flat_mdf(8, 2.0);
    mdf->deepest_mm = 6.0;
    g_autoptr(Viewer) view = silhouettes_view(mesh, mdf);
    struct viewer_settings s = viewer_settings_default;
    s.tiles_u = s.tiles_v = 1.0;
    s.camera_elevation_deg = 35.0;
    s.camera_distance = 4.0;
    s.silhouettes = s.visibility.straight = s.visibility.volume = TRUE;
    g_autofree float *seen = viewer_render_geometry(view, &s, VIEWER_GEOMETRY_LIT, W, H, &error);
    g_assert_no_error(error);
    g_autofree float *to_eye = viewer_render_geometry(view, &s, VIEWER_GEOMETRY_VIEW, W, H, &error);
    g_assert_no_error(error);
    int n = 0;
    for (int k = 0; k < W * H; k++) {
        const double theta = acos((double)to_eye[4 * k + 2]), first = 40.0 * G_PI / 180.0;
        const double last = 75.0 * G_PI / 180.0, share = (theta - first) / (last - first);
        if (seen[4 * k + 3] < 0.5F || share < 0.0 || share > 1.0)
            continue;
        const double mm = (1.0 - share) * 2.0 / cos(first) + share * 2.0 / cos(last);
        g_assert_cmpfloat(fabs((double)seen[4 * k + 1] / 0.04 - mm), <, 0.03);
        n++;
    }
    g_assert_cmpint(n, >, W * H / 10);
    mdf->phi_deg[5] += 3.0f;
    g_assert_true(viewer_set_mdf(view, &(struct mdf_source){.table = mdf}, &error));
    g_assert_null(view_picture(view, &s, W, H, &unlike));
    g_assert_nonnull(strstr(unlike->message, "--mdf-volume"));
}

struct material {
    const char *kind;
    double relief_mm, reference_mm;
};

/* The mean difference between the distances from the eye to the structure that the viewer found and
 * the traced ones, where both see the shape. */
static double distance_error(const float *seen, const struct displaced_pixel *truth) {
    double sum = 0.0;
    int n = 0;
    for (int k = 0; k < W * H; k++) {
        const float *p = seen + 4 * (gsize)k;
        const double error = fabs((double)(p[1] + p[2] - truth[k].distance));
        if (p[3] < 0.5F || truth[k].part != DISPLACED_SHAPE)
            continue;
        sum += fmin(error, 0.2);
        n++;
    }
    return sum / MAX(n, 1);
}

static void check_tiling(const struct material *m, World *world, Viewer *view, int u, int v) {
    struct scene_options scene = {u, v, SCENE_Z_UP, TRUE};
    g_autoptr(Mesh) mesh = ok(scene_make("torus", &scene, ERR));
    ok(viewer_set_mesh(view, mesh, ERR));
    struct truth_surface surface;
    truth_surface(world, &surface);
    struct displaced_shape shape =
        silhouettes_displaced(&silhouettes_torus, u, v, TRUE, 25.0, m->reference_mm);
    g_autoptr(Displaced) displaced = displaced_new(&surface, &shape);
    struct viewer_settings s = viewer_settings_default;
    s.shadows = TRUE;
    viewer_fit(view, &s, (double)W / H);
    g_autofree struct displaced_pixel *truth =
        silhouettes_trace(&silhouettes_torus, displaced, &s, W, H);
    struct scores scores[3]; /* BTF alone, chords, shell */
    double distances[3];
    for (int way = 0; way < 3; way++) {
        s.silhouettes = way > 0;
        s.visibility.views = way == 1;
        g_autofree float *seen = see(view, &s, W, H);
        scores[way] = silhouettes_score(&silhouettes_torus, seen, truth, &s, W, H, TRUE);
        distances[way] = distance_error(seen, truth);
    }
    static const char *const ways[] = {"BTF alone", "chords", "shell"};
    for (int way = 0; way < 3; way++)
        g_test_message("%s %dx%d, %s: outline %.4f, shadow %.4f, distances off by %.4f", m->kind, u,
                       v, ways[way], overlap_share(&scores[way].outline),
                       overlap_share(&scores[way].shadow), distances[way]);
    g_assert_cmpfloat(distances[1], <, 0.2 * distances[0]);
    g_assert_cmpfloat(overlap_share(&scores[1].outline), >=, 0.97);
    g_assert_cmpfloat(overlap_share(&scores[1].shadow), >=, 0.97);
    g_assert_cmpfloat(distances[2], <, 0.12 * distances[0]);
    g_assert_cmpfloat(overlap_share(&scores[2].outline), >=, 0.985);
    g_assert_cmpfloat(overlap_share(&scores[2].shadow), >=, 0.98);
    g_assert_cmpfloat(1.0 - overlap_share(&scores[0].outline), >,
                      1.5 * (1.0 - overlap_share(&scores[1].outline)));
    g_assert_cmpfloat(1.0 - overlap_share(&scores[0].shadow), >,
                      1.3 * (1.0 - overlap_share(&scores[1].shadow)));
}

/* Wang et al. 2005 fig. 10 and 11. */
static void test_truth(gconstpointer data) {
    const struct material *m = data;
    g_autoptr(World) world = silhouettes_world(m->kind, m->relief_mm);
    struct truth_grid grid = {TEXELS, TEXELS, 25.0, 25.0, m->reference_mm};
    g_autofree char *mdf = silhouettes_write_truth(world, &grid);
    g_autoptr(Mesh) plane = scene_plane();
    g_autoptr(Viewer) view = silhouettes_view(plane, NULL);
    ok(viewer_open_mdf(view, mdf, ERR));
    check_tiling(m, world, view, 8, 3);
    check_tiling(m, world, view, 6, 2);
    check_tiling(m, world, view, 3, 1);
}

struct bad {
    const char *name, *says;
    float value;
    gboolean no_angle, no_texel, other_size, no_channel;
};

static void write_bad(const struct bad *bad, const char *path) {
    static const char *const channels[] = {"D", NULL}, *const others[] = {"N", NULL};
    struct exr_file *file = exr_file_new();
    for (int k = 0; k < 3; k++) {
        g_autofree char *name = g_strdup_printf("view_%04d", k);
        int size = bad->other_size && k == 1 ? 3 : 4;
        struct exr_part *part =
            exr_part_new(name, size, size, bad->no_channel ? others : channels, EXR_FLOAT);
        for (int i = 0; i < size * size; i++)
            part->planes[0][i] = k == 1 ? bad->value : 1.0f;
        if (!bad->no_angle || k != 2)
            exr_set_double(part, "view.theta_deg", 30.0);
        exr_set_double(part, "view.phi_deg", 120.0 * k);
        if (!bad->no_texel)
            exr_set_double(part, "texel_mm", 1.0);
        exr_file_add(file, part);
    }
    ok(exr_write(path, file, EXR_NONE, FALSE, ERR));
    exr_file_free(file);
}

TEST(table__bad) {
    static const struct bad bads[] = {
        {"NaN", "is nan mm, but must be", .value = NAN},
        {"infinite", "is inf mm, but must be", .value = INFINITY},
        {"far", "is 1e+09 mm, but must be −60000 to", .value = 1e9f},
        {"unseen", "no laser position saw", .value = -1.0f},
        {"no angle", "view.theta_deg", .value = 1.0f, .no_angle = TRUE},
        {"no texel size", "texel_mm", .value = 1.0f, .no_texel = TRUE},
        {"other size", "texels, but the first view has", .value = 1.0f, .other_size = TRUE},
        {"no distances", "lacks channel D", .value = 1.0f, .no_channel = TRUE},
    };
    g_autofree char *path = g_build_filename(world_fixture_folder(), "bad.exr", NULL);
    for (gsize k = 0; k < G_N_ELEMENTS(bads); k++) {
        g_autoptr(GError) error = NULL;
        write_bad(&bads[k], path);
        g_assert_null(mdf_table_read(path, &error));
        g_assert_nonnull(error);
        if (strstr(error->message, bads[k].says) == NULL ||
            strstr(error->message, "bad.exr") == NULL)
            g_error("%s: %s", bads[k].name, error->message);
    }
    g_autoptr(GError) torn = NULL, missing = NULL;
    g_assert_true(g_file_set_contents(path, "v/1\001", 4, NULL));
    g_assert_null(mdf_table_read(path, &torn));
    g_assert_nonnull(torn);
    g_unlink(path);
    g_assert_null(mdf_table_read(path, &missing));
    g_assert_nonnull(missing);
}

/* What was not seen takes what is around it, across the tile's edges too. */
TEST(table__holes) {
    g_autoptr(GError) error = NULL;
    struct exr_file *file = exr_file_new();
    struct exr_part *part = mdf_file_add_view(file, 0, 5, 5, 60.0, 0.0, 1.0);
    for (int i = 0; i < 25; i++)
        part->planes[0][i] = i % 5 == 4 ? 2.0f : -1.0f;
    g_autofree char *path = g_build_filename(world_fixture_folder(), "holes.exr", NULL);
    g_assert_true(exr_write(path, file, EXR_NONE, FALSE, &error));
    exr_file_free(file);
    struct mdf_table *t = ok(mdf_table_read(path, ERR));
    for (int i = 0; i < 25; i++)
        g_assert_cmpfloat_with_epsilon(t->depth_mm[i], 1.0, 1e-5);
    g_assert_cmpfloat_with_epsilon(t->deepest_mm, 1.0, 1e-5);
    mdf_table_free(t);
}

/* Over ridges that are known, flat rays stop where a closed form says. */
TEST(table__grazing) {
    struct mdf_table *t = flat_mdf(32, 2.0);
    int before = t->n_views, n = 32 * 32;
    mdf_table_add_grazing(t);
    g_assert_cmpint(t->n_views, ==, before + 3 * 36);
    for (int k = before; k < t->n_views; k++)
        for (int i = 0; i < n; i++)
            g_assert_cmpfloat_with_epsilon(t->depth_mm[k * n + i], 2.0, 0.05);
    mdf_table_free(t);
}

/* A flat structure needs no raised relief. One whose flattest views end higher than its steep views
 * say needs a higher one, and grazing views over it end higher as well. */
TEST(table__raised) {
    g_autoptr(MdfTable) flat = flat_mdf(32, 2.0);
    g_autoptr(MdfTable) waves = flat_mdf(32, 2.0);
    const int n = 32 * 32;
    for (int k = 0; k < 24 * n; k++)
        waves->depth_mm[k] = 2.0F + 1.5F * sinf((float)(k % 32) * (float)G_PI / 8.0F);
    waves->deepest_mm = 3.5;
    mdf_table_trace(waves);
    g_autoptr(MdfTable) posts = mdf_copy(waves);
    for (int k = 12 * n; k < 24 * n; k++)
        posts->depth_mm[k] *= 0.75F;
    g_test_message("raised by %.3f, with posts %.3f", mdf_table_raised(waves),
                   mdf_table_raised(posts));
    g_assert_cmpfloat(mdf_table_raised(flat), ==, 0.0);
    g_assert_cmpfloat(mdf_table_raised(posts), >, mdf_table_raised(waves) + 0.3);
    mdf_table_add_grazing(waves);
    mdf_table_add_grazing(posts);
    double higher = 0.0;
    for (int k = 24 * n; k < waves->n_views * n; k++)
        higher += (waves->depth_mm[k] - posts->depth_mm[k]) / ((waves->n_views - 24) * n);
    g_assert_cmpfloat(higher, >, 0.05);
}

GPU_TEST(missing) {
    g_autoptr(GError) none = NULL, file = NULL, layers = NULL;
    g_autoptr(Mesh) mesh = scene_sphere();
    g_autoptr(Viewer) view = silhouettes_view(mesh, NULL);
    struct viewer_settings s = viewer_settings_default;
    s.silhouettes = TRUE;
    g_assert_null(view_picture(view, &s, 40, 30, &none));
    g_assert_nonnull(strstr(none->message, "mdf.exr"));
    g_assert_false(viewer_open_mdf(view, "/nonexistent/mdf.exr", &file));
    g_assert_nonnull(strstr(file->message, "/nonexistent/mdf.exr"));
    s.visibility.layers = 0;
    g_assert_false(viewer_settings_check(&s, &layers));
}

BEFORE_TESTS {
    static const struct material weave = {"weave", 1.2, 1.75}, brick = {"brick", 1.8, 2.4};
    gpu_fixture_add("/silhouettes/truth/weave", test_truth, &weave);
    gpu_fixture_add("/silhouettes/truth/brick", test_truth, &brick);
}

AFTER_TESTS {
    world_fixture_clean();
}
