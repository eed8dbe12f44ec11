/* Writes a BTF as large as those of UBO2014 as a file of Bonn, for tests/bench/large_btf. The
 * material is a formula: a bumpy weave of two yarns with highlights, shadows, fine texture and the
 * noise of a camera. One line of texels is in memory for each thread. */
#include "bench.h"

#include "base/vec.h"
#include "base/work.h"
#include "exr/exr_half.h"
#include "formats/bonn/bonn_private.h"

#include <fcntl.h>
#include <math.h>
#include <string.h>
#include <unistd.h>

#define COLOURS 3
#define SPREAD  75.0 /* largest polar angle of the directions, degrees */
#define NOISE   0.003F
#define DARK    0.0002F
#define NORMALS (1 << 16)

static int texels = 64, views = 40, lights = 40;
static const GOptionEntry entries[] = {
    {"texels", 't', 0, G_OPTION_ARG_INT, &texels, "Texels of a side (64)", "N"},
    {"views", 'v', 0, G_OPTION_ARG_INT, &views, "Number of views (40)", "N"},
    {"lights", 'l', 0, G_OPTION_ARG_INT, &lights, "Number of lights (40)", "N"},
    {NULL},
};

struct large {
    struct vec3 *views, *lights;
    float *noise; /* NORMALS random numbers of variance 1 */
    gsize starts_at;
    int fd;
    gint failed;
};

static guint64 mix(guint64 z) {
    z = (z ^ z >> 30) * 0xbf58476d1ce4e5b9u;
    z = (z ^ z >> 27) * 0x94d049bb133111ebu;
    return z ^ z >> 31;
}

/* Returns a random number of 0 … 1 that belongs to a place. */
static double at_random(int x, int y, int of) {
    return (double)(mix((guint64)x << 40 ^ (guint64)y << 20 ^ (guint64)of) >> 11) * 0x1p-53;
}

/* Sets n directions that cover the cap of SPREAD degrees evenly (a Fibonacci spiral). */
static void spread(int n, float *ret_theta_deg, float *ret_phi_deg, struct vec3 *ret) {
    for (int i = 0; i < n; i++) {
        const double low = cos(SPREAD * G_PI / 180), z = 1 - (1 - low) * i / MAX(n - 1, 1);
        const double phi = i * G_PI * (3 - sqrt(5));
        ret_theta_deg[i] = (float)(acos(z) * 180 / G_PI);
        ret_phi_deg[i] = (float)(fmod(phi, 2 * G_PI) * 180 / G_PI);
        ret[i] = vec3(sqrt(1 - z * z) * cos(phi), sqrt(1 - z * z) * sin(phi), z);
    }
}

/* Returns a random number of 0 … 1 that changes smoothly over `over` texels. */
static double smooth(int x, int y, int over, int of) {
    const int i = x / over, j = y / over;
    double u = (double)(x % over) / over, v = (double)(y % over) / over;
    u = u * u * (3 - 2 * u), v = v * v * (3 - 2 * v);
    const double top = (1 - u) * at_random(i, j, of) + u * at_random(i + 1, j, of);
    const double below = (1 - u) * at_random(i, j + 1, of) + u * at_random(i + 1, j + 1, of);
    return (1 - v) * top + v * below;
}

struct surface {
    struct vec3 normal;
    double slope_x, slope_y;
    float albedo[COLOURS], gloss, sharpness;
};

static struct surface surface_at(int x, int y) {
    const double u = 2 * G_PI * x / 23, v = 2 * G_PI * y / 23;
    const gboolean warp = sin(u) * sin(v) > 0;
    const double fine = smooth(x, y, 5, 1) - 0.5, grain = smooth(x, y, 3, 2);
    struct surface s;
    s.slope_x = 0.5 * cos(u) * sin(v) + 0.15 * fine;
    s.slope_y = 0.5 * sin(u) * cos(v) + 0.15 * (smooth(x, y, 5, 3) - 0.5);
    s.normal = vec3_unit(vec3(-s.slope_x, -s.slope_y, 1));
    for (int c = 0; c < COLOURS; c++) {
        const double base[2][COLOURS] = {{0.42, 0.12, 0.08}, {0.15, 0.22, 0.35}};
        s.albedo[c] = (float)(base[warp][c] * (0.7 + 0.4 * grain + 0.2 * sin(0.011 * x * (c + 1))));
    }
    s.gloss = warp ? 0.5F : 0.15F;
    s.sharpness = warp ? 40 : 15;
    return s;
}

/* Returns how much of a direction the bumps around a texel leave free: 0 … 1. */
static float free_of(const struct surface *s, struct vec3 to) {
    const double rise = s->slope_x * to.x + s->slope_y * to.y;
    return (float)(1 / (1 + exp(6 * (2.2 * rise - to.z - 0.3))));
}

/* Computes all values of a texel: views × lights × 3 halves. */
static void texel_values(const struct large *large, int x, int y, float *values, guint16 *ret) {
    const struct surface s = surface_at(x, y);
    const gsize row = (gsize)lights * COLOURS;
    g_autofree float *lit = g_new0(float, lights);
    for (int l = 0; l < lights; l++)
        lit[l] =
            (float)fmax(vec3_dot(s.normal, large->lights[l]), 0) * free_of(&s, large->lights[l]);
    for (int v = 0; v < views; v++) {
        const float seen = 0.3F + 0.7F * free_of(&s, large->views[v]);
        const float *noise = large->noise;
        for (int l = 0; l < lights; l++) {
            const struct vec3 half = vec3_unit(vec3_add(large->views[v], large->lights[l]));
            const float lobe = s.gloss * expf(s.sharpness * ((float)vec3_dot(half, s.normal) - 1));
            const guint64 draws =
                mix(((guint64)y * 8192 + (guint64)x) << 24 ^ (guint64)(v * lights + l));
            for (int c = 0; c < COLOURS; c++) {
                const float value = lit[l] * seen * (s.albedo[c] + lobe);
                const float error = noise[draws >> 16 * c & (NORMALS - 1)];
                values[(gsize)l * COLOURS + (gsize)c] =
                    value + error * (NOISE * sqrtf(value) + DARK);
            }
        }
        exr_half_from_floats(ret + (gsize)v * row, values, row);
    }
}

/* Writes line y of texels, which is one chunk. */
static void write_line(int y, gpointer data) {
    struct large *large = data;
    const gsize each = (gsize)views * (gsize)lights * COLOURS;
    const gsize bytes = (gsize)texels * each * sizeof(guint16);
    const guint32 size = GUINT32_TO_LE((guint32)bytes);
    g_autofree guint8 *chunk = g_malloc(sizeof size + bytes);
    g_autofree float *values = g_new(float, (gsize)lights *COLOURS);
    memcpy(chunk, &size, sizeof size);
    g_autofree guint16 *halves = g_new(guint16, each);
    for (int x = 0; x < texels; x++) {
        texel_values(large, x, y, values, halves);
        memcpy(chunk + sizeof size + (gsize)x * each * sizeof *halves, halves,
               each * sizeof *halves);
    }
    const gsize all = sizeof size + bytes;
    for (gsize done = 0; done < all;) {
        const gssize n = pwrite(large->fd, chunk + done, all - done,
                                (off_t)(large->starts_at + (gsize)y * all + done));
        if (n <= 0) {
            g_atomic_int_set(&large->failed, 1);
            return;
        }
        done += (gsize)n;
    }
}

static void put_front(struct large *large, struct bonn_header *header) {
    g_autoptr(GByteArray) front = g_byte_array_new();
    bonn_put_header(front, header);
    const guint8 full = 0, there = 1;
    bytes_put_u32(front, 1); /* lines of a chunk */
    g_byte_array_append(front, &full, 1);
    for (int i = 0; i < texels * texels; i++)
        g_byte_array_append(front, &there, 1);
    bytes_put_u32(front, 0); /* rotations */
    large->starts_at = front->len;
    if (write(large->fd, front->data, front->len) != (gssize)front->len)
        bench_fail(1, "the file cannot be written; is the disk full?");
}

static void draw_noise(struct large *large) {
    large->noise = g_new(float, NORMALS);
    for (int i = 0; i < NORMALS; i++) { /* Box and Muller 1958 */
        const double a = at_random(i, 0, 5), b = at_random(i, 1, 5);
        large->noise[i] = (float)(sqrt(-2 * log(1 - a)) * cos(2 * G_PI * b));
    }
}

int main(int argc, char **argv) {
    bench_parse(&argc, &argv, entries, "FILE.btf");
    if (argc != 2 || texels < 1 || views < 1 || lights < 1)
        bench_fail(2, "give one file, and numbers above 0");
    struct large large = {.views = g_new(struct vec3, views), .lights = g_new(struct vec3, lights)};
    struct bonn_header header = {.kind = BONN_BDI,
                                 .setup = g_strdup("bench_large"),
                                 .texels_a_mm = 10,
                                 .rgb_scale = {1, 1, 1},
                                 .cosine = TRUE,
                                 .width = texels,
                                 .height = texels,
                                 .n_views = views,
                                 .n_lights = lights,
                                 .view_theta_deg = g_new(float, views),
                                 .view_phi_deg = g_new(float, views),
                                 .light_theta_deg = g_new(float, lights),
                                 .light_phi_deg = g_new(float, lights)};
    spread(views, header.view_theta_deg, header.view_phi_deg, large.views);
    spread(lights, header.light_theta_deg, header.light_phi_deg, large.lights);
    draw_noise(&large);
    large.fd = open(argv[1], O_WRONLY | O_CREAT | O_TRUNC, 0666);
    if (large.fd < 0)
        bench_fail(1, "%s: cannot be written", argv[1]);
    put_front(&large, &header);
    work_for_each(0, texels, write_line, &large);
    if (large.failed || close(large.fd) != 0)
        bench_fail(1, "%s: cannot be written; is the disk full?", argv[1]);
    bench_begin(NULL);
    bench_put("%d{texels} %d{views} %d{lights} %.2f{gigabytes}", texels, views, lights,
              2.0 * COLOURS * texels * texels * views * lights / 1e9);
    bench_end();
    bonn_header_clear(&header);
    g_free(large.views);
    g_free(large.lights);
    g_free(large.noise);
    return 0;
}
