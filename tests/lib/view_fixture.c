#include "view_fixture.h"
#include "lib/ok.h"

#include <gio/gio.h>
#include <png.h>

struct vec3 view_fixture_mix(struct vec3 a, double s, struct vec3 b, double t) {
    return vec3(s * a.x + t * b.x, s * a.y + t * b.y, s * a.z + t * b.z);
}

double texel_code(int i, int j) {
    return (1.0 + i + W * j) / (2.0 + W * H);
}

void fill_texel(enum kind kind, int term, struct vec3 l, int i, int j, float *ret) {
    double code = texel_code(i, j);
    double values[N_KINDS][3] = {
        {0.5 + 0.4 * l.x, 0.5 + 0.4 * l.y, code},
        {0.5, 0.5, code},
        {(i + 0.5) / W, (j + 0.5) / H, code},
        {0.5, 0.5, 0.5},
        {l.z, l.z, l.z},
        {0.5 + 0.4 * sin(2.0 * G_PI * (i + 0.5) / W), 0.5 + 0.4 * cos(2.0 * G_PI * (j + 0.5) / H),
         code},
    };
    for (int c = 0; c < 3; c++)
        ret[c] = term == 0 ? values[kind][c] : kind == VIEW && term == c + 1 && c < 2 ? 0.4 : 0.0;
}

static void view_fixture_directions(int n_rings, int n_phi, double offset, float **ret_theta,
                                    float **ret_phi) {
    *ret_theta = g_new(float, n_rings *n_phi);
    *ret_phi = g_new(float, n_rings *n_phi);
    for (int k = 0; k < n_rings * n_phi; k++) {
        (*ret_theta)[k] = 85.0 / n_rings * (1 + k / n_phi);
        (*ret_phi)[k] = offset + 360.0 / n_phi * (k % n_phi);
    }
}

struct eigenmaps *view_fixture_material(enum kind kind, int n_rings, int n_phi) {
    struct eigenmaps *m = g_new0(struct eigenmaps, 1);
    m->name = g_strdup("test");
    m->layout.width = W;
    m->layout.height = H;
    m->layout.texel_mm = 1.0;
    m->layout.views.n = m->layout.lights.n = n_rings * n_phi;
    m->n_terms = 5;
    view_fixture_directions(n_rings, n_phi, 0.0, &m->layout.views.theta_deg,
                            &m->layout.views.phi_deg);
    view_fixture_directions(n_rings, n_phi, 5.0, &m->layout.lights.theta_deg,
                            &m->layout.lights.phi_deg);
    m->weights = g_new0(float, m->n_terms * m->layout.views.n);
    for (gsize k = 0; k < m->layout.views.n; k++) {
        struct vec3 v = direction_of_deg(m->layout.views.theta_deg[k], m->layout.views.phi_deg[k]);
        m->weights[k] = 1.0;
        m->weights[m->layout.views.n + k] = v.x;
        m->weights[2 * m->layout.views.n + k] = v.y;
    }
    m->maps = g_new(float, (gsize)m->n_terms * m->layout.lights.n * W * H * 3);
    float *out = m->maps;
    for (int term = 0; term < m->n_terms; term++)
        for (gsize light = 0; light < m->layout.lights.n; light++)
            for (int k = 0; k < W * H; k++, out += 3)
                fill_texel(kind, term,
                           direction_of_deg(m->layout.lights.theta_deg[light],
                                            m->layout.lights.phi_deg[light]),
                           k % W, k / W, out);
    return m;
}

struct viewer_settings view_fixture_settings(void) {
    struct viewer_settings s = viewer_settings_default;
    s.ambient = 0.0;
    s.tiles_u = s.tiles_v = 1.0;
    s.style.nearest = TRUE;
    s.camera_distance = 3.0;
    return s;
}

struct vec3 view_fixture_ray(const struct viewer_settings *s, double radius, int width, int height,
                             int i, int j, struct vec3 *ret_eye) {
    struct vec3 back = direction_of_deg(90.0 - s->camera_elevation_deg, s->camera_azimuth_deg);
    struct vec3 right =
        vec3(-sin(s->camera_azimuth_deg * DEG), cos(s->camera_azimuth_deg * DEG), 0.0);
    struct vec3 up = vec3(back.y * right.z - back.z * right.y, back.z * right.x - back.x * right.z,
                          back.x * right.y - back.y * right.x);
    double half = tan(0.5 * s->camera_fov_deg * DEG) / MIN(width, height);
    double x = (2 * i + 1 - width) * half, y = (height - 2 * j - 1) * half;
    *ret_eye = view_fixture_mix(back, s->camera_distance * radius, back, 0.0);
    struct vec3 d = view_fixture_mix(view_fixture_mix(right, x, up, y), 1.0, back, -1.0);
    return view_fixture_mix(d, 1.0 / sqrt(vec3_dot(d, d)), d, 0.0);
}

struct hit view_fixture_hit_torus(struct vec3 eye, struct vec3 d) {
    struct hit hit = {.to_eye = view_fixture_mix(d, -1.0, d, 0.0)};
    double along = 0.0, distance = 1.0;
    struct vec3 p = eye;
    for (int k = 0; k < 500 && along < 20.0 && distance > 1e-7; k++) {
        distance = hypot(hypot(p.x, p.y) - 1.0, p.z) - 0.4;
        along += distance;
        p = view_fixture_mix(eye, 1.0, d, along);
    }
    hit.found = distance <= 1e-6;
    double a = atan2(p.y, p.x), b = atan2(p.z, hypot(p.x, p.y) - 1.0);
    hit.u = a / (2.0 * G_PI);
    hit.v = b / (2.0 * G_PI);
    hit.t = vec3(-sin(a), cos(a), 0.0);
    hit.b = vec3(-sin(b) * cos(a), -sin(b) * sin(a), cos(b));
    hit.n = vec3(cos(b) * cos(a), cos(b) * sin(a), sin(b));
    return hit;
}

/* Returns FALSE where a small error of the mesh would change the answer. */
static gboolean view_fixture_expect(const struct check *c, const struct hit *hit, double ret[3]) {
    struct vec3 l = direction_of_deg(c->settings->light_theta_deg, c->settings->light_phi_deg);
    struct vec3 local_l = vec3(vec3_dot(l, hit->t), vec3_dot(l, hit->b), vec3_dot(l, hit->n));
    struct vec3 local_v = vec3(vec3_dot(hit->to_eye, hit->t), vec3_dot(hit->to_eye, hit->b), 0.0);
    double cosine = vec3_dot(hit->to_eye, hit->n);
    double x = hit->u * c->settings->tiles_u * W, y = -hit->v * c->settings->tiles_v * H;
    double fx = x - floor(x), fy = y - floor(y);
    if (cosine < 0.2 || fx < 0.06 || fx > 0.94 || fy < 0.06 || fy > 0.94)
        return FALSE;
    if (local_l.z < cos(84.0 * DEG)) /* light fades below the lowest measured light */
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

void view_fixture_compare(const struct check *c, double tolerance, int at_least) {
    int n = 0, wrong_texel = 0, wrong = 0;
    double worst = 0.0;
    for (int j = 0; j < c->height; j++)
        for (int i = 0; i < c->width; i++) {
            struct vec3 eye,
                d = view_fixture_ray(c->settings, c->radius, c->width, c->height, i, j, &eye);
            struct hit hit = c->find(eye, d);
            double expected[3];
            if (!hit.found || !view_fixture_expect(c, &hit, expected))
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

Viewer *view_fixture_view(enum kind kind, int n_rings, int n_phi, const struct mesh *mesh) {
    struct eigenmaps *material = view_fixture_material(kind, n_rings, n_phi);
    Viewer *view = ok(viewer_new(material, ERR));
    eigenmaps_free(material);
    ok(viewer_set_mesh(view, mesh, ERR));
    return view;
}

Viewer *view_fixture_plane(enum kind kind, int n_rings, int n_phi) {
    g_autoptr(Mesh) mesh = scene_plane();
    Viewer *view = view_fixture_view(kind, n_rings, n_phi, mesh);
    return view;
}

float *view_fixture_linear(Viewer *view, const struct viewer_settings *s, int width, int height) {
    float *pixels = ok(viewer_render_linear(view, s, width, height, ERR));
    return pixels;
}

guint8 *view_fixture_read_png(const char *path, int *ret_width, int *ret_height) {
    png_image image = {.version = PNG_IMAGE_VERSION};
    g_assert_true(png_image_begin_read_from_file(&image, path));
    image.format = PNG_FORMAT_RGB;
    guint8 *rgb = g_malloc(PNG_IMAGE_SIZE(image));
    g_assert_true(png_image_finish_read(&image, NULL, rgb, 0, NULL));
    *ret_width = (int)image.width;
    *ret_height = (int)image.height;
    png_image_free(&image);
    return rgb;
}

gboolean view_fixture_have_program(void) {
    const gboolean there = g_file_test(VIEWER, G_FILE_TEST_IS_EXECUTABLE);
    if (!there)
        test_skip_or_fail("mesorig-view is not built");
    return there;
}

void write_view(enum kind kind, const struct eigenmaps *m, int view, const char *dir) {
    g_autoptr(GError) error = NULL;
    static const char *const channels[] = {"B", "G", "R", NULL};
    struct exr_file *file = exr_file_new();
    for (gsize light = 0; light < m->layout.lights.n; light++) {
        g_autofree char *name = g_strdup_printf("light_%04zu", light);
        struct exr_part *part = exr_part_new(name, W, H, channels, EXR_HALF);
        exr_set_double(part, "view.theta_deg", m->layout.views.theta_deg[view]);
        exr_set_double(part, "view.phi_deg", m->layout.views.phi_deg[view]);
        exr_set_double(part, "light.theta_deg", m->layout.lights.theta_deg[light]);
        exr_set_double(part, "light.phi_deg", m->layout.lights.phi_deg[light]);
        struct vec3 l =
            direction_of_deg(m->layout.lights.theta_deg[light], m->layout.lights.phi_deg[light]);
        struct vec3 v =
            direction_of_deg(m->layout.views.theta_deg[view], m->layout.views.phi_deg[view]);
        for (int k = 0; k < W * H; k++) {
            float rgb[3];
            fill_texel(kind, 0, l, k % W, k / W, rgb);
            part->planes[2][k] = rgb[0] + (kind == VIEW ? 0.4 * v.x : 0.0);
            part->planes[1][k] = rgb[1] + (kind == VIEW ? 0.4 * v.y : 0.0);
            part->planes[0][k] = rgb[2];
        }
        exr_file_add(file, part);
    }
    g_autofree char *path = g_strdup_printf("%s/view_%04d.exr", dir, view);
    g_assert_true(exr_write(path, file, EXR_NONE, FALSE, &error));
    exr_file_free(file);
}

char *view_fixture_write_btf(enum kind kind, int n_rings, int n_phi) {
    char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    struct eigenmaps *m = view_fixture_material(kind, n_rings, n_phi);
    for (gsize view = 0; view < m->layout.views.n; view++)
        write_view(kind, m, view, dir);
    eigenmaps_free(m);
    return dir;
}

void remove_folder(const char *path) {
    g_autoptr(GDir) dir = g_dir_open(path, 0, NULL);
    for (const char *name; (name = g_dir_read_name(dir)) != NULL;) {
        g_autofree char *file = g_build_filename(path, name, NULL);
        g_assert_cmpint(g_unlink(file), ==, 0);
    }
    g_assert_cmpint(g_rmdir(path), ==, 0);
}

char *view_fixture_write_session(void) {
    char *dir = g_dir_make_tmp("mesorig-XXXXXX", NULL);
    g_autofree char *products = g_build_filename(dir, "products", NULL);
    g_autofree char *path = g_build_filename(products, "eigenmaps.exr", NULL);
    g_mkdir(products, 0755);
    struct eigenmaps *material = view_fixture_material(LIGHT, 3, 4);
    ok(eigenmaps_write(path, material, ERR));
    eigenmaps_free(material);
    return dir;
}

void view_fixture_remove_session(const char *dir, const char *const *pictures) {
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
