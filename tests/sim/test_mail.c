/* Chain mail, as the world has it: its rings are found in the mesh, and are measured there. Nothing
 * is taken from the code that makes them. */
#include "lib/test.h"
#include "world/truth.h"

#include "lib/world_fixture.h"

#include <string.h>

#define BASE_MM 0.4
#define POINTS  128 /* of a centre circle */

/* A torus: its centre, the direction of x in its plane (of which y is the other one), and radii. */
struct ring {
    double centre[3], out[3], ring_mm, wire_mm;
};

struct mail {
    World *world;
    struct truth_surface surface;
    guint32 *body; /* of each vertex: the first vertex of its body */
    GArray *rings; /* of struct ring */
};

static const float *vertex_at(const struct mail *m, guint32 i) {
    return m->surface.vertices + (gsize)m->surface.stride * i;
}

static guint32 root(guint32 *body, guint32 i) {
    while (body[i] != i)
        i = body[i] = body[body[i]];
    return i;
}

/* Bodies are sets of triangles that share vertices. */
static void find_bodies(struct mail *m) {
    const struct truth_surface *s = &m->surface;
    m->body = g_new(guint32, s->n_vertices);
    for (guint32 i = 0; i < s->n_vertices; i++)
        m->body[i] = i;
    for (gsize k = 0; k < s->n_triangles; k++)
        for (int c = 1; c < 3; c++) {
            guint32 a = root(m->body, s->triangles[3 * k]);
            guint32 b = root(m->body, s->triangles[3 * k + c]);
            m->body[MAX(a, b)] = MIN(a, b);
        }
    for (guint32 i = 0; i < s->n_vertices; i++)
        m->body[i] = root(m->body, i);
}

/* Fits a torus to a body. Its plane contains y; the other direction is the first principal axis of
 * the coordinates x and z. */
static struct ring fit_ring(const struct mail *m, guint32 body) {
    struct ring ring = {.wire_mm = 0};
    double n = 0, xx = 0, xz = 0, zz = 0, low = G_MAXDOUBLE, high = 0;
    for (guint32 i = body; i < m->surface.n_vertices; i++)
        if (m->body[i] == body) {
            for (int k = 0; k < 3; k++)
                ring.centre[k] += vertex_at(m, i)[k];
            n++;
        }
    for (int k = 0; k < 3; k++)
        ring.centre[k] /= n;
    for (guint32 i = body; i < m->surface.n_vertices; i++) {
        double x = vertex_at(m, i)[0] - ring.centre[0], z = vertex_at(m, i)[2] - ring.centre[2];
        if (m->body[i] == body) {
            xx += x * x;
            xz += x * z;
            zz += z * z;
        }
    }
    double tilt = atan2(2 * xz, xx - zz) / 2;
    ring.out[0] = cos(tilt);
    ring.out[2] = sin(tilt);
    for (guint32 i = body; i < m->surface.n_vertices; i++)
        if (m->body[i] == body) {
            const float *p = vertex_at(m, i);
            double u =
                (p[0] - ring.centre[0]) * ring.out[0] + (p[2] - ring.centre[2]) * ring.out[2];
            double r = hypot(u, p[1] - ring.centre[1]);
            low = MIN(low, r);
            high = MAX(high, r);
        }
    ring.ring_mm = (low + high) / 2;
    ring.wire_mm = (high - low) / 2;
    return ring;
}

/* A body is a ring if it has a vertex above the floor. */
static void find_rings(struct mail *m) {
    g_autofree gboolean *above = g_new0(gboolean, m->surface.n_vertices);
    for (guint32 i = 0; i < m->surface.n_vertices; i++)
        if (vertex_at(m, i)[2] > BASE_MM + 1e-3)
            above[m->body[i]] = TRUE;
    m->rings = g_array_new(FALSE, FALSE, sizeof(struct ring));
    for (guint32 i = 0; i < m->surface.n_vertices; i++)
        if (above[i]) {
            struct ring ring = fit_ring(m, i);
            g_array_append_val(m->rings, ring);
        }
}

static struct mail mail_new(const char *keys) {
    struct mail m = {.body = NULL};
    g_autofree char *text = g_strdup_printf(
        "[world]\nnoise=no\ngather_rays=0\n[camera a]\ntheta_deg=30\n[lamp l]\ntheta_deg=45\n"
        "[sample]\nkind=mail\nbase_mm=%g\ntop_mm=40\n%s",
        BASE_MM, keys);
    m.world = world_fixture_new(text);
    truth_surface(m.world, &m.surface);
    find_bodies(&m);
    find_rings(&m);
    return m;
}

static void mail_clear(struct mail *m) {
    world_unref(m->world);
    g_free(m->body);
    g_array_unref(m->rings);
}

static const struct ring *ring_at(const struct mail *m, guint i) {
    return &g_array_index(m->rings, struct ring, i);
}

static double highest(const struct mail *m) {
    double top = 0;
    for (guint32 i = 0; i < m->surface.n_vertices; i++)
        top = MAX(top, (double)vertex_at(m, i)[2]);
    return top;
}

static void circle(const struct ring *ring, double to[POINTS][3]) {
    for (int i = 0; i < POINTS; i++) {
        double c = cos(2 * G_PI * i / POINTS), s = sin(2 * G_PI * i / POINTS);
        for (int k = 0; k < 3; k++)
            to[i][k] = ring->centre[k] + ring->ring_mm * c * ring->out[k];
        to[i][1] += ring->ring_mm * s;
    }
}

/* The integral of Gauss, 1/(4 pi) of (a - b) . (da x db) / |a - b|^3 over both curves, by midpoints
 * of chords; and the least distance of points on them. */
static double linking_number(const struct ring *a, const struct ring *b, double *ret_least_mm) {
    double p[POINTS][3], q[POINTS][3], sum = 0, least2 = G_MAXDOUBLE;
    circle(a, p);
    circle(b, q);
    for (int i = 0; i < POINTS; i++)
        for (int j = 0; j < POINTS; j++) {
            double d[3], u[3], v[3], d2 = 0, apart2 = 0;
            for (int k = 0; k < 3; k++) {
                const double *p1 = p[(i + 1) % POINTS], *q1 = q[(j + 1) % POINTS];
                u[k] = p1[k] - p[i][k];
                v[k] = q1[k] - q[j][k];
                d[k] = (p1[k] + p[i][k] - q1[k] - q[j][k]) / 2;
                d2 += d[k] * d[k];
                apart2 += pow(p[i][k] - q[j][k], 2);
            }
            sum += (d[0] * (u[1] * v[2] - u[2] * v[1]) + d[1] * (u[2] * v[0] - u[0] * v[2]) +
                    d[2] * (u[0] * v[1] - u[1] * v[0])) /
                   (d2 * sqrt(d2));
            least2 = MIN(least2, apart2);
        }
    *ret_least_mm = sqrt(least2);
    return sum / (4 * G_PI);
}

/* Each ring passes through two of the row before and two of the row after it, and no wires touch.
 * Returns the least clearance between wires as a part of the wire's radius. */
static double check_links(const struct mail *m, double p, double q) {
    double least = G_MAXDOUBLE;
    for (guint i = 0; i < m->rings->len; i++)
        for (guint j = 0; j < i; j++) {
            const struct ring *a = ring_at(m, i), *b = ring_at(m, j);
            double dx = fabs(a->centre[0] - b->centre[0]), dy = fabs(a->centre[1] - b->centre[1]);
            double reach = a->ring_mm + a->wire_mm + b->ring_mm + b->wire_mm, apart;
            if (hypot(dx, dy) > reach)
                continue;
            const gboolean neighbours = fabs(dx - p / 2) < 0.01 * p && fabs(dy - q) < 0.01 * q;
            double number = linking_number(a, b, &apart);
            if (fabs(fabs(number) - (neighbours ? 1 : 0)) > 0.02)
                g_error("rings %.2f, %.2f mm apart have the linking number %.3f", dx, dy, number);
            double clearance = apart - a->wire_mm - b->wire_mm;
            if (clearance < 0.1 * a->wire_mm)
                g_error("wires %.2f, %.2f mm apart: clearance %.4f mm", dx, dy, clearance);
            least = MIN(least, clearance / a->wire_mm);
        }
    return least;
}

TEST(linked) {
    static const struct {
        double size_mm[2], relief_mm, period_mm;
        int repeats, seed;
        double p, q; /* what they are rounded to */
    } mails[] = {
        {{24, 24}, 1.8, 2.5, 2, 1, 2.4, 1.5},
        {{20, 20}, 3, 4, 1, 2, 4, 20.0 / 8},
        {{25, 25}, 3.2, 6.25, 1, 3, 6.25, 25.0 / 6},
        {{25, 25}, 0.4, 6.25, 1, 4, 6.25, 25.0 / 6}, /* hardly any tilt */
        {{25, 25}, 30, 6.25, 1, 5, 6.25, 25.0 / 6},  /* the largest one */
        {{30, 6}, 2, 9, 1, 6, 30.0 / 7, 3},          /* two rows, which decide */
        {{6, 30}, 2, 9, 1, 7, 6, 30.0 / 8},          /* one ring a row */
    };
    for (gsize k = 0; k < G_N_ELEMENTS(mails); k++) {
        g_autofree char *keys = g_strdup_printf(
            "width_mm=%g\nheight_mm=%g\nrelief_mm=%g\nperiod_mm=%g\nrepeats=%d\nseed=%d\n",
            mails[k].size_mm[0], mails[k].size_mm[1], mails[k].relief_mm, mails[k].period_mm,
            mails[k].repeats, mails[k].seed);
        struct mail m = mail_new(keys);
        const double p = mails[k].p, q = mails[k].q, least = check_links(&m, p, q);
        const struct ring *ring = ring_at(&m, 0);
        const double area = mails[k].size_mm[0] * mails[k].size_mm[1];
        g_test_message(
            "p %g, q %g: R %.3f, r %.3f mm, tilt %.1f deg, clearance %.2f r, top %.3f mm", p, q,
            ring->ring_mm, ring->wire_mm, atan2(ring->out[2], ring->out[0]) * 180 / G_PI, least,
            highest(&m));
        g_assert_cmpfloat_with_epsilon(m.rings->len, area / (p * q), 1e-6);
        g_assert_cmpfloat(highest(&m), <=, BASE_MM + mails[k].relief_mm + 1e-5);
        mail_clear(&m);
    }
}

/* The relief is used where the pattern is not limited by its largest tilt, and nothing is higher.
 */
TEST(height) {
    static const double reliefs[] = {0, 0.3, 0.8, 1.8, 3};
    for (gsize k = 0; k < G_N_ELEMENTS(reliefs); k++) {
        g_autofree char *keys =
            g_strdup_printf("width_mm=30\nheight_mm=30\nperiod_mm=5\nrelief_mm=%g\n", reliefs[k]);
        struct mail m = mail_new(keys);
        g_assert_cmpfloat(highest(&m), <=, BASE_MM + reliefs[k] + 1e-5);
        g_assert_cmpfloat(highest(&m), >=, BASE_MM + 0.95 * reliefs[k] - 1e-5);
        g_assert_cmpint(m.rings->len > 0, ==, reliefs[k] > 0);
        for (guint i = 0; i < m.rings->len; i++)
            g_assert_cmpfloat(fabs(ring_at(&m, i)->out[2]) * ring_at(&m, i)->ring_mm +
                                  ring_at(&m, i)->wire_mm,
                              <=, ring_at(&m, i)->centre[2] - BASE_MM + 1e-5);
        mail_clear(&m);
    }
}

/* Each edge of a ring belongs to two triangles, which pass it in opposite directions. */
TEST(closed) {
    struct mail m = mail_new("width_mm=12\nheight_mm=12\nperiod_mm=3\nrelief_mm=2\n");
    g_autoptr(GHashTable) edges = g_hash_table_new_full(g_int64_hash, g_int64_equal, g_free, NULL);
    double volume = 0;
    for (gsize k = 0; k < m.surface.n_triangles; k++) {
        const guint32 *corner = m.surface.triangles + 3 * k;
        const float *a = vertex_at(&m, corner[0]), *b = vertex_at(&m, corner[1]),
                    *c = vertex_at(&m, corner[2]);
        if (MAX(MAX(a[2], b[2]), c[2]) < BASE_MM + 1e-4)
            continue;
        volume += (a[0] * (double)(b[1] * c[2] - b[2] * c[1]) +
                   a[1] * (double)(b[2] * c[0] - b[0] * c[2]) +
                   a[2] * (double)(b[0] * c[1] - b[1] * c[0])) /
                  6;
        for (int i = 0; i < 3; i++) {
            gint64 edge = (gint64)corner[i] << 32 | corner[(i + 1) % 3];
            g_assert_true(g_hash_table_add(edges, g_memdup2(&edge, sizeof edge)));
        }
    }
    GHashTableIter each;
    gpointer key;
    g_hash_table_iter_init(&each, edges);
    while (g_hash_table_iter_next(&each, &key, NULL)) {
        const guint64 edge = *(guint64 *)key;
        gint64 back = (gint64)(edge << 32 | edge >> 32);
        g_assert_true(g_hash_table_contains(edges, &back));
    }
    double expected = 0; /* of the tori; they are inscribed, and have outer faces outside */
    for (guint i = 0; i < m.rings->len; i++)
        expected += 2 * G_PI * G_PI * ring_at(&m, i)->ring_mm * pow(ring_at(&m, i)->wire_mm, 2);
    g_assert_cmpfloat(volume, >, 0.9 * expected);
    g_assert_cmpfloat(volume, <, expected);
    mail_clear(&m);
}

/* Pieces are alike, with their tilts; other seeds give other tilts. */
TEST(pieces) {
    const char *keys = "width_mm=24\nheight_mm=24\nperiod_mm=3\nrelief_mm=2\nrepeats=2\nseed=%d\n";
    double tilt[2] = {0};
    for (int seed = 1; seed <= 2; seed++) {
        g_autofree char *text = g_strdup_printf(keys, seed);
        struct mail m = mail_new(text);
        int like = 0;
        double low = G_MAXDOUBLE, high = 0;
        for (guint i = 0; i < m.rings->len; i++)
            for (guint j = 0; j < m.rings->len; j++) {
                const struct ring *a = ring_at(&m, i), *b = ring_at(&m, j);
                if (fabs(b->centre[0] - a->centre[0] - 12) > 1e-3 ||
                    fabs(b->centre[1] - a->centre[1]) > 1e-3)
                    continue;
                g_assert_cmpfloat_with_epsilon(a->out[2], b->out[2], 1e-4);
                low = MIN(low, fabs(a->out[2]));
                high = MAX(high, fabs(a->out[2]));
                like++;
            }
        g_assert_cmpint(like, ==, m.rings->len / 2);
        g_assert_cmpfloat(high, >, 1.03 * low);
        tilt[seed - 1] = ring_at(&m, 0)->out[2];
        mail_clear(&m);
    }
    g_assert_cmpfloat(fabs(tilt[0] - tilt[1]), >, 1e-4);
}

/* Returns the number of wires above (x, y): faces of rings that look down. */
static int wires_above(const struct mail *m, double x, double y) {
    int n = 0;
    for (gsize k = 0; k < m->surface.n_triangles; k++) {
        const float *p[3];
        int sides = 0;
        for (int c = 0; c < 3; c++)
            p[c] = vertex_at(m, m->surface.triangles[3 * k + c]);
        for (int c = 0; c < 3; c++) {
            const float *a = p[c], *b = p[(c + 1) % 3];
            sides += (b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) < 0;
        }
        n += sides == 3; /* clockwise from above */
    }
    return n;
}

/* What is scored: wires above the floor, wires above wires, and floor that is seen. */
TEST(no_height_field) {
    struct mail m = mail_new("width_mm=25\nheight_mm=25\nperiod_mm=2.5\nrelief_mm=1.8\n");
    const int lines = 400;
    int above[2] = {0};
    for (int i = 0; i < lines; i++) {
        double x = -10 + 20 * fmod((i + 1) * 0.754877666, 1);
        double y = -10 + 20 * fmod((i + 1) * 0.569840296, 1);
        int n = wires_above(&m, x, y);
        above[0] += n >= 1;
        above[1] += n >= 2;
    }
    g_test_message("%.3f wire, %.3f two wires", (double)above[0] / lines, (double)above[1] / lines);
    g_assert_cmpfloat((double)above[0] / lines, >, 0.5);
    g_assert_cmpfloat((double)above[0] / lines, <, 0.9);
    g_assert_cmpfloat((double)above[1] / lines, >, 0.1);
    mail_clear(&m);
}

AFTER_TESTS {
    world_fixture_clean();
}
