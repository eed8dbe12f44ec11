/*
 * Pictures against what the formula gives. Materials are analytic functions of texel, view and
 * light, and the rays, hit points and frames they are evaluated for are computed here, in doubles
 * and without the renderer's code: an error of orientation anywhere shows as another colour.
 */
#include "renderer/gpu.h"
#include "renderer/picture.h"
#include "renderer/scene.h"
#include "renderer/view.h"

#include <glib/gstdio.h>
#include <math.h>
#include <png.h>
#include <string.h>
#include <sys/wait.h>

#define DEG (G_PI / 180.0)
#define W   7 /* texels: odd, not a power of two, not square */
#define H   5

struct v3 {
    double x, y, z;
};

static struct v3 v3(double x, double y, double z) {
    return (struct v3){x, y, z};
}

static double dot(struct v3 a, struct v3 b) {
    return a.x * b.x + a.y * b.y + a.z * b.z;
}

static struct v3 mix(struct v3 a, double s, struct v3 b, double t) {
    return v3(s * a.x + t * b.x, s * a.y + t * b.y, s * a.z + t * b.z);
}

static struct v3 unit(double theta_deg, double phi_deg) {
    double theta = theta_deg * DEG, phi = phi_deg * DEG;
    return v3(sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta));
}

/* Term 0 gives red = 0.5 + 0.4 l_x, green = 0.5 + 0.4 l_y, blue = the texel's number; terms 1 and 2
 * add 0.4 v_x to red and 0.4 v_y to green. Terms 3 and 4 weigh nothing. */
enum kind { LIGHT, VIEW, TEXEL, GREY, COSINE, N_KINDS };

static double texel_code(int i, int j) {
    return (1.0 + i + W * j) / (2.0 + W * H);
}

static void fill_texel(enum kind kind, int term, struct v3 l, int i, int j, float *ret) {
    double code = texel_code(i, j);
    double values[N_KINDS][3] = {
        {0.5 + 0.4 * l.x, 0.5 + 0.4 * l.y, code},
        {0.5, 0.5, code},
        {(i + 0.5) / W, (j + 0.5) / H, code},
        {0.5, 0.5, 0.5},
        {l.z, l.z, l.z},
    };
    for (int c = 0; c < 3; c++)
        ret[c] = term == 0 ? values[kind][c] : kind == VIEW && term == c + 1 && c < 2 ? 0.4 : 0.0;
}

static void fill_directions(int n_rings, int n_phi, double offset, float **ret_theta,
                            float **ret_phi) {
    *ret_theta = g_new(float, n_rings *n_phi);
    *ret_phi = g_new(float, n_rings *n_phi);
    for (int k = 0; k < n_rings * n_phi; k++) {
        (*ret_theta)[k] = 85.0 / n_rings * (1 + k / n_phi);
        (*ret_phi)[k] = offset + 360.0 / n_phi * (k % n_phi);
    }
}

static struct eigenmaps *make_material(enum kind kind, int n_rings, int n_phi) {
    struct eigenmaps *m = g_new0(struct eigenmaps, 1);
    m->name = g_strdup("test");
    m->width = W;
    m->height = H;
    m->texel_mm = 1.0;
    m->n_views = m->n_lights = n_rings * n_phi;
    m->n_terms = 5;
    fill_directions(n_rings, n_phi, 0.0, &m->view_theta_deg, &m->view_phi_deg);
    fill_directions(n_rings, n_phi, 5.0, &m->light_theta_deg, &m->light_phi_deg);
    m->weights = g_new0(float, m->n_terms * m->n_views);
    for (int k = 0; k < m->n_views; k++) {
        struct v3 v = unit(m->view_theta_deg[k], m->view_phi_deg[k]);
        m->weights[k] = 1.0;
        m->weights[m->n_views + k] = v.x;
        m->weights[2 * m->n_views + k] = v.y;
    }
    m->maps = g_new(float, (gsize)m->n_terms * m->n_lights * W * H * 3);
    float *out = m->maps;
    for (int term = 0; term < m->n_terms; term++)
        for (int light = 0; light < m->n_lights; light++)
            for (int k = 0; k < W * H; k++, out += 3)
                fill_texel(kind, term, unit(m->light_theta_deg[light], m->light_phi_deg[light]),
                           k % W, k / W, out);
    return m;
}

static struct view_settings bare_settings(void) {
    struct view_settings s = view_settings_default;
    s.ambient = 0.0;
    s.tiles_u = s.tiles_v = 1.0;
    s.nearest = TRUE;
    s.camera_distance = 3.0;
    return s;
}

/* The ray through the middle of a pixel, from this file's own idea of the camera. */
static struct v3 ray(const struct view_settings *s, double radius, int width, int height, int i,
                     int j, struct v3 *ret_eye) {
    struct v3 back = unit(90.0 - s->camera_elevation_deg, s->camera_azimuth_deg);
    struct v3 right = v3(-sin(s->camera_azimuth_deg * DEG), cos(s->camera_azimuth_deg * DEG), 0.0);
    struct v3 up = v3(back.y * right.z - back.z * right.y, back.z * right.x - back.x * right.z,
                      back.x * right.y - back.y * right.x);
    double half = tan(0.5 * s->camera_fov_deg * DEG) / MIN(width, height);
    double x = (2 * i + 1 - width) * half, y = (height - 2 * j - 1) * half;
    *ret_eye = mix(back, s->camera_distance * radius, back, 0.0);
    struct v3 d = mix(mix(right, x, up, y), 1.0, back, -1.0);
    return mix(d, 1.0 / sqrt(dot(d, d)), d, 0.0);
}

struct hit {
    gboolean found;
    double u, v; /* one tile */
    struct v3 t, b, n, to_eye;
};

static struct hit hit_plane(struct v3 eye, struct v3 d) {
    double along = -eye.z / d.z;
    struct v3 p = mix(eye, 1.0, d, along);
    struct hit hit = {along > 0.0 && fabs(p.x) < 0.99 && fabs(p.y) < 0.99,
                      0.5 * (p.x + 1.0),
                      0.5 * (p.y + 1.0),
                      v3(1, 0, 0),
                      v3(0, 1, 0),
                      v3(0, 0, 1),
                      mix(d, -1.0, d, 0.0)};
    return hit;
}

/* By steps of the distance from the surface. */
static struct hit hit_torus(struct v3 eye, struct v3 d) {
    struct hit hit = {.to_eye = mix(d, -1.0, d, 0.0)};
    double along = 0.0, distance = 1.0;
    struct v3 p = eye;
    for (int k = 0; k < 500 && along < 20.0 && distance > 1e-7; k++) {
        distance = hypot(hypot(p.x, p.y) - 1.0, p.z) - 0.4;
        along += distance;
        p = mix(eye, 1.0, d, along);
    }
    hit.found = distance <= 1e-6;
    double a = atan2(p.y, p.x), b = atan2(p.z, hypot(p.x, p.y) - 1.0);
    hit.u = a / (2.0 * G_PI);
    hit.v = b / (2.0 * G_PI);
    hit.t = v3(-sin(a), cos(a), 0.0);
    hit.b = v3(-sin(b) * cos(a), -sin(b) * sin(a), cos(b));
    hit.n = v3(cos(b) * cos(a), cos(b) * sin(a), sin(b));
    return hit;
}

struct check {
    enum kind kind;
    const struct view_settings *settings;
    const float *pixels;
    int width, height;
    double radius;
    struct hit (*find)(struct v3 eye, struct v3 d);
};

/* Returns FALSE where a small error of the mesh would change the answer. */
static gboolean expect(const struct check *c, const struct hit *hit, double ret[3]) {
    struct v3 l = unit(c->settings->light_theta_deg, c->settings->light_phi_deg);
    struct v3 local_l = v3(dot(l, hit->t), dot(l, hit->b), dot(l, hit->n));
    struct v3 local_v = v3(dot(hit->to_eye, hit->t), dot(hit->to_eye, hit->b), 0.0);
    double cosine = dot(hit->to_eye, hit->n);
    double x = hit->u * c->settings->tiles_u * W, y = -hit->v * c->settings->tiles_v * H;
    double fx = x - floor(x), fy = y - floor(y);
    if (cosine < 0.2 || fx < 0.06 || fx > 0.94 || fy < 0.06 || fy > 0.94)
        return FALSE;
    if (local_l.z < cos(84.0 * DEG)) /* beyond the lowest light it fades */
        return FALSE;
    int i = ((int)floor(x) % W + W) % W, j = ((int)floor(y) % H + H) % H;
    float texel[3];
    fill_texel(c->kind, 0, local_l, i, j, texel);
    for (int k = 0; k < 3; k++)
        ret[k] = texel[k];
    if (c->kind == VIEW) {
        ret[0] += 0.4 * local_v.x;
        ret[1] += 0.4 * local_v.y;
    }
    return TRUE;
}

/* Compares every pixel that can be told; the texel must be right in (nearly) all, the rest within
 * the error of linear interpolation between the material's directions. */
static void compare(const struct check *c, double tolerance, int at_least) {
    int n = 0, wrong_texel = 0, wrong = 0;
    double worst = 0.0;
    for (int j = 0; j < c->height; j++)
        for (int i = 0; i < c->width; i++) {
            struct v3 eye, d = ray(c->settings, c->radius, c->width, c->height, i, j, &eye);
            struct hit hit = c->find(eye, d);
            double expected[3];
            if (!hit.found || !expect(c, &hit, expected))
                continue;
            const float *p = c->pixels + 4 * ((gsize)j * c->width + i);
            double error = fmax(fabs(p[0] - expected[0]), fabs(p[1] - expected[1]));
            n++;
            wrong_texel += fabs(p[2] - expected[2]) > 0.3 / (W * H);
            wrong += error > tolerance;
            worst = fmax(worst, error);
        }
    g_test_message("%d pixels, worst error %.4f, beyond %.4f: %d, wrong texel: %d", n, worst,
                   tolerance, wrong, wrong_texel);
    g_assert_cmpint(n, >=, at_least);
    g_assert_cmpint(wrong_texel, <=, n / 500);
    g_assert_cmpint(wrong, <=, n / 500);
}

struct fixture {
    Gpu *gpu;
};

static void set_up(struct fixture *f, gconstpointer data) {
    g_autoptr(GError) error = NULL;
    f->gpu = gpu_new_headless(&error);
    if (f->gpu == NULL)
        g_test_skip(error->message);
}

static void tear_down(struct fixture *f, gconstpointer data) {
    gpu_free(f->gpu);
}

static View *make_view(enum kind kind, int n_rings, int n_phi, const struct mesh *mesh) {
    g_autoptr(GError) error = NULL;
    struct eigenmaps *material = make_material(kind, n_rings, n_phi);
    View *view = view_new(material, &error);
    g_assert_no_error(error);
    eigenmaps_free(material);
    view_set_mesh(view, mesh, &error);
    g_assert_no_error(error);
    return view;
}

static void check_kind(enum kind kind, struct mesh *mesh, const struct view_settings *s,
                       struct hit (*find)(struct v3, struct v3), double tolerance) {
    g_autoptr(GError) error = NULL;
    g_autoptr(View) view = make_view(kind, 12, 24, mesh);
    struct check c = {kind, s, NULL, 120, 90, mesh->radius, find};
    g_autofree float *pixels = view_render_linear(view, s, c.width, c.height, &error);
    g_assert_no_error(error);
    c.pixels = pixels;
    compare(&c, tolerance, 1000);
}

static void check_mesh(struct mesh *mesh, struct view_settings s,
                       struct hit (*find)(struct v3, struct v3)) {
    check_kind(TEXEL, mesh, &s, find, 1e-3);
    check_kind(VIEW, mesh, &s, find, 0.012);
    check_kind(LIGHT, mesh, &s, find, 0.012);
    mesh_free(mesh);
}

static void test_plane(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    struct view_settings s = bare_settings();
    s.camera_distance = 1.6;
    s.camera_fov_deg = 60.0;
    s.camera_azimuth_deg = -70.0;
    s.camera_elevation_deg = 50.0;
    s.light_theta_deg = 40.0;
    s.light_phi_deg = 130.0;
    s.tiles_u = 2.0;
    s.tiles_v = 1.5;
    check_mesh(scene_plane(), s, hit_plane);
}

static void test_plane_from_above(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    struct view_settings s = bare_settings();
    s.camera_elevation_deg = 90.0;
    s.light_theta_deg = 3.0;
    s.light_phi_deg = 300.0;
    check_mesh(scene_plane(), s, hit_plane);
}

static void test_torus(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    struct view_settings s = bare_settings();
    s.camera_distance = 2.5;
    s.tiles_u = 3.0;
    s.tiles_v = 1.0;
    check_mesh(scene_torus(1.0, 0.4, 512, 256), s, hit_torus);
}

/* Of all pixels that show the mesh. */
static void mean_pixel(const float *pixels, int n, double ret[3]) {
    int found = 0;
    memset(ret, 0, 3 * sizeof(double));
    for (int k = 0; k < n; k++)
        if (pixels[4 * k + 3] > 0.5f) {
            found++;
            for (int c = 0; c < 3; c++)
                ret[c] += pixels[4 * k + c];
        }
    g_assert_cmpint(found, >, 0);
    for (int c = 0; c < 3; c++)
        ret[c] /= found;
}

/* A white diffuser is BTF = n·l: it must follow the cosine all the way down, also below the lowest
 * measured light, be dark beyond, and reflect an even sky in full. */
static void test_diffuser(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    g_autoptr(GError) error = NULL;
    struct mesh *mesh = scene_plane();
    g_autoptr(View) view = make_view(COSINE, 5, 12, mesh);
    mesh_free(mesh);
    struct view_settings s = bare_settings();
    s.nearest = FALSE;
    const double thetas[] = {0.0, 10.0, 17.0, 34.0, 60.0, 80.0, 86.0, 89.0, 91.0, 150.0};
    double mean[3];
    for (gsize k = 0; k < G_N_ELEMENTS(thetas); k++) {
        s.light_theta_deg = thetas[k];
        g_autofree float *pixels = view_render_linear(view, &s, 40, 30, &error);
        g_assert_no_error(error);
        mean_pixel(pixels, 40 * 30, mean);
        double expected = fmax(cos(thetas[k] * DEG), 0.0);
        /* The pole is the mean of the ring at 17°. */
        g_assert_cmpfloat_with_epsilon(mean[1], expected, thetas[k] < 17.0 ? 0.045 : 0.012);
    }
    s.ambient = 0.5;
    g_autofree float *pixels = view_render_linear(view, &s, 40, 30, &error);
    mean_pixel(pixels, 40 * 30, mean);
    g_assert_cmpfloat_with_epsilon(mean[1], 0.5, 0.015);
}

static double srgb(double x) {
    return 255.0 * (x <= 0.0031308 ? 12.92 * x : 1.055 * pow(x, 1.0 / 2.4) - 0.055);
}

/* Bytes: exposure, tone and transfer, without and with supersampling. */
static void test_bytes(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    struct mesh *mesh = scene_plane();
    g_autoptr(View) view = make_view(GREY, 5, 12, mesh);
    mesh_free(mesh);
    const struct {
        double ev, linear;
    } cases[] = {{0.0, 0.4}, {-2.0, 0.1}, {1.0, 0.8}, {2.0, 1.0 - 0.2 * exp(-4.0)}, {9.0, 1.0}};
    for (gsize k = 0; k < G_N_ELEMENTS(cases); k++)
        for (int samples = 1; samples <= 4; samples += 3) {
            g_autoptr(GError) error = NULL;
            struct view_settings s = bare_settings();
            s.camera_elevation_deg = 90.0;
            s.camera_distance = 0.5;
            s.light_theta_deg = 20.0;
            s.exposure_ev = cases[k].ev;
            s.samples = samples;
            g_autofree guint8 *rgb = view_render(view, &s, 16, 12, &error);
            g_assert_no_error(error);
            for (int b = 0; b < 16 * 12 * 3; b++)
                g_assert_cmpfloat_with_epsilon(rgb[b], srgb(cases[k].linear), 1.01);
        }
}

/* Where texels are far smaller than pixels the picture is their mean and does not shimmer. */
static void test_minified(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    struct mesh *mesh = scene_plane();
    g_autoptr(View) view = make_view(TEXEL, 5, 12, mesh);
    mesh_free(mesh);
    g_autoptr(GError) error = NULL;
    struct view_settings s = bare_settings();
    s.nearest = FALSE;
    s.tiles_u = s.tiles_v = 200.0;
    s.camera_elevation_deg = 90.0;
    s.light_theta_deg = 20.0;
    s.camera_distance = 1.0;
    g_autofree float *pixels = view_render_linear(view, &s, 40, 30, &error);
    g_assert_no_error(error);
    for (int k = 0; k < 40 * 30; k++)
        for (int c = 0; c < 3; c++)
            g_assert_cmpfloat_with_epsilon(pixels[4 * k + c], 0.5, 0.06);
}

static void refuse(struct eigenmaps *material, const char *said) {
    g_autoptr(GError) error = NULL;
    g_assert_null(view_new(material, &error));
    g_assert_nonnull(error);
    g_test_message("%s", error->message);
    g_assert_nonnull(strstr(error->message, said));
    eigenmaps_free(material);
}

static void test_bad_material(struct fixture *f, gconstpointer data) {
    if (f->gpu == NULL)
        return;
    struct eigenmaps *m = make_material(GREY, 3, 4);
    m->maps[(2 * 12 + 5) * W * H * 3 + 8 * 3] = NAN;
    refuse(m, "term 2, light 5, texel (1, 1)");
    m = make_material(GREY, 3, 4);
    m->weights[13] = INFINITY;
    refuse(m, "term 1 for view 1");
    m = make_material(GREY, 3, 4);
    m->light_theta_deg[2] = 100.0f;
    refuse(m, "lights: direction 2");
    m = make_material(GREY, 3, 4);
    m->view_phi_deg[2] = NAN;
    refuse(m, "views: direction 2");
    m = make_material(GREY, 3, 4);
    m->n_terms = 100000; /* refused before anything of it is read */
    refuse(m, "layers");
    m = make_material(GREY, 3, 4);
    m->width = 1 << 20;
    refuse(m, "texels");
    m = make_material(GREY, 3, 4);
    m->n_lights = 0;
    refuse(m, "no texels or directions");
}

static void test_bad_settings(struct fixture *f, gconstpointer data) {
    struct view_settings s = view_settings_default;
    g_autoptr(GError) error = NULL, nan = NULL, size = NULL;
    g_assert_true(view_settings_check(&s, &error));
    s.camera_fov_deg = 180.0;
    g_assert_false(view_settings_check(&s, &error));
    g_assert_nonnull(strstr(error->message, "1 … 120"));
    s = view_settings_default;
    s.exposure_ev = NAN;
    g_assert_false(view_settings_check(&s, &nan));
    g_assert_nonnull(strstr(nan->message, "exposure"));
    if (f->gpu == NULL)
        return;
    struct mesh *mesh = scene_plane();
    g_autoptr(View) view = make_view(GREY, 3, 4, mesh);
    mesh_free(mesh);
    s = view_settings_default;
    g_assert_null(view_render(view, &s, 1000000, 2, &size));
    g_assert_error(size, GPU_ERROR, GPU_ERROR_TOO_LARGE);
}

static void read_png(const char *path, int *ret_width, int *ret_height, guint8 **ret_rgb) {
    png_image image = {.version = PNG_IMAGE_VERSION};
    g_assert_true(png_image_begin_read_from_file(&image, path));
    image.format = PNG_FORMAT_RGB;
    *ret_width = image.width;
    *ret_height = image.height;
    *ret_rgb = g_malloc(PNG_IMAGE_SIZE(image));
    g_assert_true(png_image_finish_read(&image, NULL, *ret_rgb, 0, NULL));
    png_image_free(&image);
}

static void test_png(struct fixture *f, gconstpointer data) {
    g_autoptr(GError) error = NULL, folder = NULL;
    g_autofree char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *path = g_build_filename(dir, "a.png", NULL);
    guint8 rgb[5 * 3 * 3];
    for (gsize k = 0; k < sizeof rgb; k++)
        rgb[k] = 37 * k;
    const char *texts[] = {"Shape", "torus", "Light", "theta 50°", NULL};
    g_assert_true(picture_write_png(path, rgb, 5, 3, texts, &error));
    g_assert_no_error(error);
    int width, height;
    g_autofree guint8 *read = NULL;
    read_png(path, &width, &height, &read);
    g_assert_cmpint(width, ==, 5);
    g_assert_cmpint(height, ==, 3);
    g_assert_cmpmem(read, sizeof rgb, rgb, sizeof rgb);
    g_autofree char *bytes = NULL;
    gsize length;
    g_assert_true(g_file_get_contents(path, &bytes, &length, NULL));
    g_assert_nonnull(memmem(bytes, length, "tEXtShape\0torus", 15));
    g_assert_nonnull(memmem(bytes, length, "theta 50°", 10));
    g_unlink(path);
    g_rmdir(dir);
    g_assert_false(picture_write_png(path, rgb, 5, 3, texts, &folder));
    g_assert_error(folder, PICTURE_ERROR, PICTURE_ERROR_IO);
}

static int run_program(const char *const *arguments, char **ret_out, char **ret_err) {
    g_autoptr(GPtrArray) argv = g_ptr_array_new();
    for (; *arguments != NULL; arguments++)
        g_ptr_array_add(argv, (gpointer)*arguments);
    g_ptr_array_add(argv, NULL);
    int status;
    g_autoptr(GError) error = NULL;
    g_spawn_sync(NULL, (char **)argv->pdata, NULL, G_SPAWN_SEARCH_PATH, NULL, NULL, ret_out,
                 ret_err, &status, &error);
    g_assert_no_error(error);
    g_assert_true(WIFEXITED(status));
    return WEXITSTATUS(status);
}

#define PROGRAM BUILD_DIR "/bin/mesorig-view"

static gboolean have_program(struct fixture *f) {
    if (f->gpu != NULL && g_file_test(PROGRAM, G_FILE_TEST_IS_EXECUTABLE))
        return TRUE;
    g_test_skip("no OpenGL, or mesorig-view is not built");
    return FALSE;
}

static void check_usage(int status, const char *const *arguments, const char *said) {
    g_autofree char *out = NULL, *err = NULL;
    g_assert_cmpint(run_program(arguments, &out, &err), ==, status);
    g_test_message("%s", err);
    g_assert_nonnull(strstr(err, said));
}

static void test_program_usage(struct fixture *f, gconstpointer data) {
    if (!have_program(f))
        return;
    check_usage(2, (const char *[]){PROGRAM, NULL}, "one MATERIAL");
    check_usage(2, (const char *[]){PROGRAM, "--bogus", NULL}, "--bogus");
    check_usage(2, (const char *[]){PROGRAM, "a", "-o", "b", "--size", "0x9", NULL}, "--size 0x9");
    check_usage(2, (const char *[]){PROGRAM, "a", "-o", "b", "--tiles", "3x", NULL}, "--tiles 3x");
    check_usage(2, (const char *[]){PROGRAM, "a", "-o", "b", "--exposure", "99", NULL}, "exposure");
    check_usage(2, (const char *[]){PROGRAM, "a", "--frames", "3", NULL}, "--render");
    check_usage(1, (const char *[]){PROGRAM, "/nowhere", "-o", "b.png", NULL}, "/nowhere");
    check_usage(1, (const char *[]){PROGRAM, "/nowhere", "-o", "b", "--shape", "cow", NULL}, "cow");
    check_usage(1, (const char *[]){PROGRAM, "/", "-o", "b.png", NULL}, "products/eigenmaps.exr");
}

static char *write_session(void) {
    g_autoptr(GError) error = NULL;
    char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *products = g_build_filename(dir, "products", NULL);
    g_autofree char *path = g_build_filename(products, "eigenmaps.exr", NULL);
    g_mkdir(products, 0755);
    struct eigenmaps *material = make_material(LIGHT, 3, 4);
    eigenmaps_write(path, material, &error);
    g_assert_no_error(error);
    eigenmaps_free(material);
    return dir;
}

static void remove_session(const char *dir, const char *const *pictures) {
    g_autofree char *products = g_build_filename(dir, "products", NULL);
    g_autofree char *path = g_build_filename(products, "eigenmaps.exr", NULL);
    for (; *pictures != NULL; pictures++) {
        g_autofree char *picture = g_build_filename(dir, *pictures, NULL);
        g_assert_cmpint(g_unlink(picture), ==, 0);
    }
    g_unlink(path);
    g_rmdir(products);
    g_assert_cmpint(g_rmdir(dir), ==, 0);
}

static void test_program_renders(struct fixture *f, gconstpointer data) {
    if (!have_program(f))
        return;
    g_autofree char *dir = write_session(), *out = NULL, *err = NULL;
    g_autofree char *path = g_build_filename(dir, "turn.png", NULL);
    const char *arguments[] = {PROGRAM,        dir,       "--render", path,       "--size",
                               "48x32",        "--shape", "sphere",   "--frames", "4",
                               "--light-turn", "--json",  NULL};
    g_assert_cmpint(run_program(arguments, &out, &err), ==, 0);
    g_assert_nonnull(strstr(out, "\"width\": 48, \"height\": 32, \"frames\": 4"));
    g_assert_nonnull(strstr(out, "turn_0003.png\"]}"));
    guint8 *rgb[2];
    for (int k = 0; k < 2; k++) {
        g_autofree char *one = g_strdup_printf("%s/turn_%04d.png", dir, 2 * k);
        int width, height;
        read_png(one, &width, &height, &rgb[k]);
        g_assert_cmpint(width, ==, 48);
    }
    g_assert_cmpint(memcmp(rgb[0], rgb[1], 48 * 32 * 3), !=, 0);
    g_free(rgb[0]);
    g_free(rgb[1]);
    remove_session(dir, (const char *[]){"turn_0000.png", "turn_0001.png", "turn_0002.png",
                                         "turn_0003.png", NULL});
}

static void test_program_window(struct fixture *f, gconstpointer data) {
    g_autofree char *xvfb = g_find_program_in_path("xvfb-run");
    if (!have_program(f))
        return;
    if (xvfb == NULL) {
        g_test_skip("no xvfb-run");
        return;
    }
    g_autofree char *dir = write_session(), *out = NULL, *err = NULL;
    g_autofree char *path = g_build_filename(dir, "window.png", NULL);
    const char *arguments[] = {xvfb,     "-a",           PROGRAM,  dir,
                               "--size", "160x120",      "--json", "--close-after",
                               "3",      "--screenshot", path,     NULL};
    int status = run_program(arguments, &out, &err);
    g_test_message("%s%s", out, err);
    g_assert_cmpint(status, ==, 0);
    g_assert_nonnull(strstr(out, "\"frames\": 3"));
    int width, height;
    g_autofree guint8 *rgb = NULL;
    read_png(path, &width, &height, &rgb);
    g_assert_cmpint(width, ==, 160);
    g_assert_cmpint(rgb[3 * (60 * 160 + 40)], >, 60); /* on the torus, left of its hole */
    remove_session(dir, (const char *[]){"window.png", NULL});
}

static void test_program_no_display(struct fixture *f, gconstpointer data) {
    if (!have_program(f))
        return;
    g_autofree char *dir = write_session();
    check_usage(
        1, (const char *[]){"env", "-u", "DISPLAY", "-u", "WAYLAND_DISPLAY", PROGRAM, dir, NULL},
        "--render");
    remove_session(dir, (const char *[]){NULL});
}

int main(int argc, char **argv) {
    g_test_init(&argc, &argv, NULL);
    const struct {
        const char *name;
        void (*run)(struct fixture *f, gconstpointer data);
    } tests[] = {
        {"/view/plane", test_plane},
        {"/view/plane-from-above", test_plane_from_above},
        {"/view/torus", test_torus},
        {"/view/diffuser", test_diffuser},
        {"/view/bytes", test_bytes},
        {"/view/minified", test_minified},
        {"/view/bad-material", test_bad_material},
        {"/view/bad-settings", test_bad_settings},
        {"/view/png", test_png},
        {"/view/program/usage", test_program_usage},
        {"/view/program/renders", test_program_renders},
        {"/view/program/window", test_program_window},
        {"/view/program/no-display", test_program_no_display},
    };
    for (gsize k = 0; k < G_N_ELEMENTS(tests); k++)
        g_test_add(tests[k].name, struct fixture, NULL, set_up, tests[k].run, tear_down);
    return g_test_run();
}
