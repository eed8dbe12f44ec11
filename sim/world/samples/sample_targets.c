#include "sample.h"

#include <math.h>

/* The samples are targets for calibrating lamps: thin posts on a light plate, or glossy balls on a
 * dark plate. */

#define POST_SIDES  128
#define BALL_AROUND 160
#define BALL_ALONG  80

struct place {
    double x, y, size; /* `size`: height of a post, or radius of a ball */
};

static void plate(struct vertex *vertex, gconstpointer data) {
    const struct sample_options *o = data;
    float own = o->kind == SAMPLE_POLES ? 0.8f : 0.05f;
    vertex->p[2] = (float)o->base_mm;
    sample_set_rgb(vertex->albedo, &o->albedo, own, own, own);
}

static struct vertex matt(const struct sample_options *o, double x, double y, double z) {
    struct vertex v = {.p = {(float)x, (float)y, (float)z}, .t = {0, 0, 1}, .along = 1};
    v.across = 1;
    sample_set_rgb(v.albedo, &o->albedo2, 0.08f, 0.08f, 0.08f);
    return v;
}

static void add_post(struct mesh *mesh, const struct sample_options *o, const struct place *at) {
    struct vertex top = matt(o, at->x, at->y, o->base_mm + at->size);
    top.n[2] = top.t[0] = 1;
    top.t[2] = 0;
    guint32 middle = sample_add_vertex(mesh, &top), first = middle + 1;
    for (int i = 0; i < POST_SIDES; i++) {
        double turn = 2 * G_PI * i / POST_SIDES, c = cos(turn), s = sin(turn);
        struct vertex rim = top;
        rim.p[0] = (float)(at->x + o->radius_mm * c);
        rim.p[1] = (float)(at->y + o->radius_mm * s);
        struct vertex side = matt(o, (double)rim.p[0], (double)rim.p[1], (double)rim.p[2]);
        side.n[0] = (float)c;
        side.n[1] = (float)s;
        struct vertex foot = side;
        foot.p[2] = (float)o->base_mm;
        sample_add_vertex(mesh, &rim);
        sample_add_vertex(mesh, &side);
        sample_add_vertex(mesh, &foot);
    }
    for (guint32 i = 0; i < POST_SIDES; i++) {
        guint32 a = first + 3 * i, b = first + 3 * ((i + 1) % POST_SIDES);
        sample_add_triangle(mesh, middle, a, b);
        sample_add_quad(mesh, a + 2, b + 2, b + 1, a + 1);
    }
}

static void add_ball(struct mesh *mesh, const struct sample_options *o, const struct place *at) {
    guint32 first = mesh->vertices->len;
    for (int i = 0; i <= BALL_ALONG; i++)
        for (int k = 0; k < BALL_AROUND; k++) {
            double theta = G_PI * i / BALL_ALONG, phi = 2 * G_PI * k / BALL_AROUND;
            double n[3] = {sin(theta) * cos(phi), sin(theta) * sin(phi), cos(theta)};
            struct vertex v = matt(o, at->x + at->size * n[0], at->y + at->size * n[1],
                                   o->base_mm + at->size * (1 + n[2]));
            for (int c = 0; c < 3; c++)
                v.n[c] = (float)n[c];
            v.t[0] = (float)-sin(phi);
            v.t[1] = (float)cos(phi);
            v.t[2] = 0;
            sample_set_gloss(&v, o, 0.05, 0.04, 0.04);
            sample_set_rgb(v.albedo, &o->albedo2, 0, 0, 0);
            sample_add_vertex(mesh, &v);
        }
    for (guint32 i = 0; i < BALL_ALONG; i++)
        for (guint32 k = 0; k < BALL_AROUND; k++) {
            guint32 a = first + i * BALL_AROUND + k;
            guint32 b = first + i * BALL_AROUND + (k + 1) % BALL_AROUND;
            sample_add_quad(mesh, a, a + BALL_AROUND, b + BALL_AROUND, b);
        }
}

struct mesh *sample_targets(const struct sample_options *o) {
    struct mesh *mesh = sample_mesh_new();
    sample_add_relief(mesh, o, 2, 2, plate, o);
    for (int i = 0; i < o->places_mm.n; i += 3) {
        const double *p = o->places_mm.values + i;
        struct place at = {p[0], p[1], p[2]};
        (o->kind == SAMPLE_POLES ? add_post : add_ball)(mesh, o, &at);
    }
    return mesh;
}
