#include "sample.h"

#include <math.h>

/* The sample is chain mail over a dark floor, in the European 4-in-1 pattern. Each ring is a closed
 * torus of round wire. It passes through four other rings: two of the row before and two of the row
 * after. The rings of a row lean along the row, all to the same side. The next row leans to the
 * other side and is shifted by half a period. Between the rings one sees the floor, and wires pass
 * above each other, so no height field describes the surface.
 *
 * Symbols:
 * - p: distance of ring centres along a row (x)
 * - q: distance of rows (y)
 * - R: radius of the centre circle of a ring
 * - r: radius of the wire
 * - t: tilt of a ring
 * - s: largest difference of a ring's tilt from t
 *
 * All centres have the same height. The plane of a ring contains the direction of y and (cos t, 0,
 * ±sin t).
 *
 * Linked rings. The centres of two neighbours in adjacent rows are (p/2, q) apart. The planes of
 * these rings meet in a line along y. The disc of each ring cuts a chord out of this line. The half
 * length of the chord is h₁, with h_k = √(R² − (k p / (4 cos t))²). The middles of the two chords
 * are q apart. The rings are linked exactly if each chord has one end within the other chord, that
 * is, if 0 < q < 2 h₁. The next ring of the adjacent row is (3p/2, q) away. It must not be linked,
 * so q > 2 h₃, or R < 3p / (4 cos t).
 *
 * Clearance between the wires. The distance of a point from a circle is √(n² + (ρ − R)²). n is the
 * height of the point above the plane of the circle, and ρ is its distance from the axis of the
 * circle. d(x, y) is the minimum of this distance over N points of the other circle, minus π R / N.
 * The subtraction is necessary, because between two of the points the distance may be smaller by at
 * most π R / N. Therefore any two centre circles are farther apart than
 *     D = min(p sin t, 2 (q − R), d(p/2, q), d(3p/2, q)).
 * The four terms are for rings in the same row, for rings two rows apart, for linked rings, and for
 * rings in adjacent rows that are not linked.
 *
 * The difference s of the tilt moves a point of a ring by at most 2 R sin(s/2), so for all tilts
 *     clearance = D − 4 R sin(s/2) − 2 r > 0.
 * No ring passes through another on the way from t to its own tilt, so the rings stay linked.
 *
 * R is chosen so that D is as large as possible. The wires take the share FILL of D − 4 R sin(s/2).
 * The tilt is the largest that fits between base_mm and relief_mm above it: R sin(t + s) + r ≤
 * relief / 2. */

#define ALONG    40   /* number of sections of a ring */
#define AROUND   12   /* number of vertices of a section */
#define ROWS     1.45 /* p / q, before rows and rings are rounded to whole numbers */
#define MAX_TILT (35 * (G_PI / 180))
#define SWAY     0.025 /* s / t */
/* share of D − 4 R sin(s/2) that the wires fill; what is left is the clearance */
#define FILL   0.9
#define POINTS 360 /* N */

struct mail {
    const struct sample_options *options;
    /* `n_x`: number of rings in a row. `n_y`: number of rows, which is even. Both are for one of
     * the `repeats` equal pieces of the sample. */
    int n_x, n_y;
    double p_mm, q_mm; /* p and q; for samples of all sizes, p / q is from 0.96 to 2.18 */
    double ring_mm, wire_mm, tilt, sway; /* R, r, t and s */
};

/* Returns d(x, y): a lower bound of the distance between two centre circles. One ring has the tilt
 * t and its centre at the origin. The other ring has the tilt −t and its centre at (x, y). */
static double distance(double ring, double tilt, double x, double y) {
    double c = cos(tilt), s = sin(tilt), least2 = G_MAXDOUBLE;
    for (int i = 0; i < POINTS; i++) {
        double a = 2 * G_PI * i / POINTS;
        double at[3] = {ring * cos(a) * c - x, ring * sin(a) - y, ring * cos(a) * s};
        double n = at[0] * s + at[2] * c, in_plane = at[0] * c - at[2] * s;
        double off = hypot(in_plane, at[1]) - ring;
        least2 = MIN(least2, n * n + off * off);
    }
    return sqrt(least2) - G_PI * ring / POINTS;
}

/* Returns half the length of the chord that the disc of a ring cuts out of a line (h_k).
 * from_centre is the distance of the line from the centre of the ring. Returns 0 if the line misses
 * the disc. */
static double half_chord(double ring, double from_centre) {
    return sqrt(MAX(0, ring * ring - from_centre * from_centre));
}

/* Returns D. Returns 0 if the wrong rings would be linked, or the right rings would not be. */
static double least_distance(const struct mail *mail, double ring, double tilt) {
    const double p = mail->p_mm, q = mail->q_mm, line = p / (4 * cos(tilt));
    if (q >= 2 * half_chord(ring, line) || q <= 2 * half_chord(ring, 3 * line))
        return 0;
    double least = MIN(p * sin(tilt), 2 * (q - ring));
    least = MIN(least, distance(ring, tilt, p / 2, q));
    return MIN(least, distance(ring, tilt, 3 * p / 2, q));
}

/* Sets the radii of rings and wire for a tilt. Returns FALSE if no radius is possible, or if the
 * rings would be too high. */
static gboolean fits(struct mail *mail, double tilt) {
    double best = 0;
    for (int i = 70; i < 100; i++) {
        double ring = mail->q_mm * i / 100, d = least_distance(mail, ring, tilt);
        if (d > best) {
            best = d;
            mail->ring_mm = ring;
        }
    }
    mail->tilt = tilt;
    mail->sway = SWAY * tilt;
    mail->wire_mm = FILL / 2 * (best - 4 * mail->ring_mm * sin(mail->sway / 2));
    return mail->wire_mm > 0 &&
           mail->ring_mm * sin(tilt + mail->sway) + mail->wire_mm <= mail->options->relief_mm / 2;
}

/* Sets the members of mail from the options. Returns FALSE if the sample is too small for rings. */
static gboolean shape_mail(struct mail *mail) {
    const struct sample_options *o = mail->options;
    const double width = o->width_mm / o->repeats, height = o->height_mm / o->repeats;
    mail->n_x = sample_count(width, o->period_mm, 1);
    mail->n_y = sample_count(height, width / mail->n_x / ROWS, 2);
    /* If only two rows fit, the rows may be too close to each other for this p. p is then made
     * smaller. */
    if (height / mail->n_y < 0.7 * width / mail->n_x / ROWS)
        mail->n_x = sample_count(width, height / mail->n_y * ROWS, 1);
    mail->p_mm = width / mail->n_x;
    mail->q_mm = height / mail->n_y;
    if (fits(mail, MAX_TILT))
        return TRUE;
    double low = 0, high = MAX_TILT;
    for (int i = 0; i < 24; i++) {
        double middle = (low + high) / 2;
        if (fits(mail, middle))
            low = middle;
        else
            high = middle;
    }
    return low > 0 && fits(mail, low);
}

/* Adds a ring. Its plane contains the directions of y and of (cos tilt, 0, sin tilt). */
static void add_ring(struct mesh *mesh, const struct mail *mail, const double centre[3],
                     double tilt, const float albedo[3]) {
    guint32 first = mesh->vertices->len;
    const double c = cos(tilt), s = sin(tilt), axis[3] = {-s, 0, c};
    for (int i = 0; i < ALONG; i++) {
        double a = 2 * G_PI * i / ALONG;
        const double out[3] = {cos(a) * c, sin(a), cos(a) * s};
        for (int k = 0; k < AROUND; k++) {
            double b = 2 * G_PI * k / AROUND;
            struct vertex vertex = {
                .t = {(float)(-sin(a) * c), (float)cos(a), (float)(-sin(a) * s)}};
            for (int j = 0; j < 3; j++) {
                double n = cos(b) * out[j] + sin(b) * axis[j];
                vertex.n[j] = (float)n;
                vertex.p[j] = (float)(centre[j] + mail->ring_mm * out[j] + mail->wire_mm * n);
                vertex.albedo[j] = albedo[j];
            }
            sample_set_gloss(&vertex, mail->options, 0.45, 0.18, 0.25);
            sample_add_vertex(mesh, &vertex);
        }
    }
    for (guint32 i = 0; i < ALONG; i++)
        for (guint32 k = 0; k < AROUND; k++) {
            guint32 here = first + i * AROUND, next = first + (i + 1) % ALONG * AROUND;
            guint32 beside = (k + 1) % AROUND;
            sample_add_quad(mesh, next + k, next + beside, here + beside, here + k);
        }
}

static void mail_floor(struct vertex *vertex, gconstpointer data) {
    const struct sample_options *o = data;
    vertex->p[2] = (float)o->base_mm;
    sample_set_rgb(vertex->albedo, &o->albedo2, 0.06f, 0.055f, 0.05f);
}

/* Rings at the edge of the sample are whole. They extend beyond the edge by less than 0.8 q,
 * because R + r < q and p > 0.9 q. */
struct mesh *sample_mail(const struct sample_options *options) {
    const struct sample_options *o = options;
    struct mesh *mesh = sample_mesh_new();
    sample_add_relief(mesh, o, 96, 96, mail_floor, o);
    struct mail mail = {.options = o};
    if (!shape_mail(&mail))
        return mesh;
    const int n_x = mail.n_x, n_y = mail.n_y, all_x = n_x * o->repeats, all_y = n_y * o->repeats;
    for (int ring = 0; ring < all_x * all_y; ring++) {
        int i = ring % all_x, j = ring / all_x, odd = j % 2;
        struct sample_random random = {
            sample_hash((guint64)o->seed * 3571 + (guint64)(j % n_y * n_x + i % n_x))};
        double tilt = mail.tilt + mail.sway * (2 * sample_uniform(&random) - 1);
        double tone = 0.8 + 0.35 * sample_uniform(&random);
        float albedo[3];
        sample_set_rgb(albedo, &o->albedo, 0.30f, 0.30f, 0.31f);
        for (int k = 0; k < 3; k++)
            albedo[k] = (float)MIN(1, albedo[k] * tone);
        const double centre[3] = {(i + 0.25 + 0.5 * odd) * mail.p_mm - o->width_mm / 2,
                                  (j + 0.5) * mail.q_mm - o->height_mm / 2,
                                  o->base_mm + mail.ring_mm * sin(mail.tilt + mail.sway) +
                                      mail.wire_mm};
        add_ring(mesh, &mail, centre, odd ? -tilt : tilt, albedo);
    }
    return mesh;
}
