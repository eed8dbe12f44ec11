/* Interpolation is separable. B[view][light] is first interpolated over lights to
 * B'[view][target light], then over views to B''[target view][target light]. Three errors are
 * summed: the error of the round trip back to the measured directions, the error of predicting
 * each measured direction from the others, and the error of using nominal directions without any
 * correction. */
#include <math.h>
#include <string.h>

#include "btf.h"
#include "texel_resampler.h"

#define LANES        RESAMPLER_LANES
#define COLOURS      3
#define DEGREE       (G_PI / 180)
#define MAX_LEFT     1024  /* maximum number of texels in the leave-one-out test */
#define COUNTS       0.02f /* minimum weight at which a corner's flags are passed to the result */
#define MOSTLY_HOLES 0.5f  /* a result with a larger share of holes is a hole */

typedef float lanes __attribute__((vector_size(16), aligned(4)));

static struct resampler_target *targets(const DirectionMesh *mesh,
                                        const struct direction_list *list) {
    struct resampler_target *ret = g_new0(struct resampler_target, list->n);
    for (gsize i = 0; i < list->n; i++) {
        ret[i].direction =
            rig_direction((double)list->theta_deg[i] * DEGREE, (double)list->phi_deg[i] * DEGREE);
        direction_mesh_point(ret[i].direction, ret[i].point);
        direction_mesh_guess(mesh, ret[i].direction, &ret[i].guess);
    }
    return ret;
}

/* Makes what the round trip needs: a mesh over the target directions, the points of these
 * directions, and guesses for the measured directions in this mesh. */
static DirectionMesh *back_mesh(const struct resampler_target *to, int n_to,
                                const struct vec3 *from, int n_from, gboolean lights,
                                double **ret_points, struct direction_guess **ret_guesses) {
    g_autofree struct vec3 *directions = g_new0(struct vec3, n_to);
    *ret_points = g_new0(double, 2 * (gsize)n_to);
    *ret_guesses = g_new0(struct direction_guess, n_from);
    for (int i = 0; i < n_to; i++) {
        directions[i] = to[i].direction;
        memcpy(*ret_points + 2 * (gsize)i, to[i].point, sizeof to[i].point);
    }
    DirectionMesh *mesh = direction_mesh_new(directions, n_to, -1, lights);
    for (int i = 0; i < n_from; i++)
        direction_mesh_guess(mesh, from[i], &(*ret_guesses)[i]);
    return mesh;
}

static struct resampler_left_out *leave_out(const struct vec3 *directions, int n, gboolean lights) {
    struct resampler_left_out *ret = g_new(struct resampler_left_out, n);
    for (int i = 0; i < n; i++) {
        ret[i].mesh = direction_mesh_new(directions, n, i, lights);
        direction_mesh_guess(ret[i].mesh, directions[i], &ret[i].guess);
    }
    return ret;
}

/* Meshes and guesses are made for directions as seen from the sample's centre. */
void resampler_init(struct resampler *r, const struct near_field *near,
                    const struct btf_directions *to, gboolean own) {
    const int n_texels = near->grid.width * near->grid.height;
    g_autofree struct vec3 *views = g_new0(struct vec3, near->views.n);
    g_autofree struct vec3 *lights = g_new0(struct vec3, near->lights.n);
    for (gsize i = 0; i < near->views.n; i++)
        views[i] = near_field_view_centre(near, i);
    for (gsize i = 0; i < near->lights.n; i++)
        lights[i] = near_field_light_centre(near, 0, i);
    *r = (struct resampler){.near = near,
                            .n_views = to->views.n,
                            .n_lights = to->lights.n,
                            .own = own,
                            .left_step = (n_texels + MAX_LEFT - 1) / MAX_LEFT};
    r->from_views = direction_mesh_new(views, near->views.n, -1, FALSE);
    r->from_lights = direction_mesh_new(lights, near->lights.n, -1, TRUE);
    r->views = targets(r->from_views, &to->views);
    r->lights = targets(r->from_lights, &to->lights);
    r->to_views = back_mesh(r->views, to->views.n, views, near->views.n, FALSE, &r->to_view_points,
                            &r->back_views);
    r->to_lights = back_mesh(r->lights, to->lights.n, lights, near->lights.n, TRUE,
                             &r->to_light_points, &r->back_lights);
    r->left_views = leave_out(views, near->views.n, FALSE);
    r->left_lights = leave_out(lights, near->lights.n, TRUE);
}

void resampler_clear(struct resampler *r) {
    for (gsize i = 0; r->left_views && i < r->near->views.n; i++)
        direction_mesh_free(r->left_views[i].mesh);
    for (gsize i = 0; r->left_lights && i < r->near->lights.n; i++)
        direction_mesh_free(r->left_lights[i].mesh);
    direction_mesh_free(r->from_views);
    direction_mesh_free(r->from_lights);
    direction_mesh_free(r->to_views);
    direction_mesh_free(r->to_lights);
    g_free(r->views);
    g_free(r->lights);
    g_free(r->to_view_points);
    g_free(r->to_light_points);
    g_free(r->back_views);
    g_free(r->back_lights);
    g_free(r->left_views);
    g_free(r->left_lights);
}

struct resampler_sums *resampler_sums_new(const struct resampler *r) {
    struct resampler_sums *sums = g_new0(struct resampler_sums, 1);
    sums->from = g_new0(struct resampler_from, r->near->views.n);
    sums->to = g_new0(struct resampler_to, r->n_views);
    return sums;
}

void resampler_sums_free(struct resampler_sums *sums) {
    if (!sums)
        return;
    g_free(sums->from);
    g_free(sums->to);
    g_free(sums);
}

void resampler_from_add(const struct resampler_from *more, struct resampler_from *to) {
    to->back += more->back;
    to->back_norm += more->back_norm;
    to->left_view += more->left_view;
    to->left_view_norm += more->left_view_norm;
    to->left_light += more->left_light;
    to->left_light_norm += more->left_light_norm;
}

void resampler_to_add(const struct resampler_to *more, struct resampler_to *to) {
    to->moved_deg += more->moved_deg;
    to->max_moved_deg = MAX(to->max_moved_deg, more->max_moved_deg);
    to->nominal += more->nominal;
    to->norm += more->norm;
    to->clamped += more->clamped;
}

void resampler_sums_add(const struct resampler *r, const struct resampler_sums *more,
                        struct resampler_sums *to) {
    for (gsize i = 0; i < r->near->views.n; i++)
        resampler_from_add(&more->from[i], &to->from[i]);
    for (int i = 0; i < r->n_views; i++)
        resampler_to_add(&more->to[i], &to->to[i]);
    to->light_moved_deg += more->light_moved_deg;
    to->light_most_moved_deg = MAX(to->light_most_moved_deg, more->light_most_moved_deg);
    to->texels += more->texels;
    to->sampled += more->sampled;
}

/* Working arrays of one texel. “lanes” means RESAMPLER_LANES floats per value. */
struct texel_work {
    const struct resampler *r;
    int texel;
    struct vec3 *views;   /* n_views */
    double *view_points;  /* n_views × 2: points of views in the stereographic plane */
    double *light_points; /* n_lights × 2: points of the lights of the view lights_of */
    /* index of the view to which the arrays of lights belong; −1 before the first view */
    int lights_of;
    /* corners and weights of each target view among the measured views */
    struct direction_share *view_shares;
    /* corners and weights of each target light among the measured lights of the view lights_of */
    struct direction_share *light_shares;
    /* corners and weights of each measured light of the view lights_of among the target lights */
    struct direction_share *back_light_shares;
    /* for each target light: whether it is beyond the limit of extrapolation in the first view */
    guint8 *clamped;
    float *values; /* n_views × n_lights × lanes; the last lane is 1 for a hole, otherwise 0 */
    guint8 *flags; /* n_views × n_lights; NULL if all are 0 */
    /* In forward(): n_views × target lights × lanes, values that are interpolated over lights only.
     * In round_trip(): target lights × lanes of one measured view. */
    float *between;
    float *slopes; /* gradients of values or between, in x and y */
};

/* Computes ret = Σ_k weight_k (f_k + along_k · g_k), see direction_mesh.h. */
static void combine(const struct direction_share *share, const float *values, const float *slopes,
                    int row, float *ret) {
    const float *f[3], *x[3], *y[3];
    for (int k = 0; k < 3; k++) {
        f[k] = values + (gsize)share->corner[k] * (gsize)row;
        x[k] = slopes + 2 * (gsize)share->corner[k] * (gsize)row;
        y[k] = x[k] + row;
    }
    for (int c = 0; c < row; c += LANES) {
        lanes sum = {0};
        for (int k = 0; k < 3; k++)
            sum += share->weight[k] *
                   (*(const lanes *)(f[k] + c) + share->along[k][0] * *(const lanes *)(x[k] + c) +
                    share->along[k][1] * *(const lanes *)(y[k] + c));
        *(lanes *)(ret + c) = sum;
    }
}

/* Computes the points and shares of a view's lights. Does nothing if the lamps stood at the same
 * positions in the view lights_of. */
static void take_lights(struct texel_work *w, int view) {
    const struct resampler *r = w->r;
    const struct vec3 *lamps = r->near->lamp_mm;
    const gsize n = r->near->lights.n;
    if (w->lights_of >= 0 &&
        (!lamps ||
         memcmp(lamps + (gsize)view * n, lamps + (gsize)w->lights_of * n, n * sizeof *lamps) == 0))
        return;
    w->lights_of = view;
    for (gsize i = 0; i < r->near->lights.n; i++)
        direction_mesh_point(near_field_light(r->near, view, i, w->texel),
                             w->light_points + 2 * (gsize)i);
    for (int i = 0; i < r->n_lights; i++)
        direction_mesh_share(r->from_lights, w->light_points, r->lights[i].point,
                             &r->lights[i].guess, &w->light_shares[i]);
    for (gsize i = 0; i < r->near->lights.n; i++)
        direction_mesh_share(r->to_lights, r->to_light_points, w->light_points + 2 * (gsize)i,
                             &r->back_lights[i], &w->back_light_shares[i]);
}

/* Copies values, and moves the flags from the last lane to w->flags. The last lane becomes 1 for a
 * hole, otherwise 0, and is interpolated like a value. */
static void take_values(struct texel_work *w, const float *values) {
    const gsize n = w->r->near->views.n * w->r->near->lights.n;
    memcpy(w->values, values, sizeof(float) * n * LANES);
    for (gsize i = 0; i < n; i++) {
        const int flag = (int)values[i * LANES + COLOURS];
        if (flag && !w->flags)
            w->flags = g_new0(guint8, n);
        if (w->flags)
            w->flags[i] = (guint8)flag;
        w->values[i * LANES + COLOURS] = (flag & BTF_FLAG_HOLE) != 0;
    }
}

/* Returns the flags, except for holes, of all corners whose weight is at least COUNTS. */
static guint8 flags_of(const struct direction_share *share, const guint8 *flags, gsize step) {
    guint8 flag = 0;
    for (int k = 0; k < 3; k++)
        if (fabsf(share->weight[k]) >= COUNTS)
            flag |= flags[(gsize)share->corner[k] * step];
    return flag & (BTF_FLAG_BOUND | BTF_FLAG_SHORTER | BTF_FLAG_PREDICTED);
}

/* Interpolates the values at the targets: first over the lights of each measured view, then over
 * the views. */
static void forward(struct texel_work *w, float *ret) {
    const struct resampler *r = w->r;
    const gsize n_lights = (gsize)r->n_lights, n_from = r->near->lights.n;
    g_autofree guint8 *half = NULL, *flags = NULL;
    if (w->flags) {
        half = g_new0(guint8, r->near->views.n * n_lights);
        flags = g_new0(guint8, (gsize)r->n_views * n_lights);
    }
    for (gsize view = 0; view < r->near->views.n; view++) {
        const float *values = w->values + (gsize)view * n_from * LANES;
        float *to = w->between + (gsize)view * n_lights * LANES;
        take_lights(w, view);
        direction_mesh_slopes(r->from_lights, values, LANES, w->slopes);
        for (gsize i = 0; i < n_lights; i++) {
            combine(&w->light_shares[i], values, w->slopes, LANES, to + i * LANES);
            if (view == 0)
                w->clamped[i] = w->light_shares[i].clamped;
            if (half)
                half[(gsize)view * n_lights + i] =
                    flags_of(&w->light_shares[i], w->flags + (gsize)view * n_from, 1);
        }
    }
    const int row = r->n_lights * LANES;
    direction_mesh_slopes(r->from_views, w->between, row, w->slopes);
    for (int view = 0; view < r->n_views; view++) {
        const gsize first = (gsize)view * n_lights;
        combine(&w->view_shares[view], w->between, w->slopes, row, ret + first * LANES);
        for (gsize i = 0; flags && i < n_lights; i++)
            flags[first + i] = flags_of(&w->view_shares[view], half + i, n_lights);
    }
    for (gsize i = 0; i < (gsize)r->n_views * n_lights; i++) {
        float *value = ret + i * LANES;
        const gboolean hole = value[COLOURS] > MOSTLY_HOLES;
        for (int c = 0; c < COLOURS; c++)
            value[c] = hole ? 0 : MAX(value[c], 0);
        value[COLOURS] = hole ? BTF_FLAG_HOLE : flags ? flags[i] : 0;
    }
}

/* Returns whether a value was measured, that is, neither a hole nor predicted. Only measured values
 * are compared, because predicted values were interpolated themselves. */
static gboolean was_measured(const struct texel_work *w, gsize i) {
    return w->values[i * LANES + COLOURS] == 0 && !(w->flags && w->flags[i] & BTF_FLAG_PREDICTED);
}

static void add_difference(const float *a, const float *b, double *error, double *norm) {
    for (int c = 0; c < COLOURS; c++) {
        const double difference = (double)a[c] - (double)b[c];
        *error += difference * difference;
        *norm += (double)b[c] * (double)b[c];
    }
}

/* Interpolates the result back at the measured directions (round trip), and sums the squared
 * differences from the measured values. */
static void round_trip(struct texel_work *w, const float *made, struct resampler_sums *sums) {
    const struct resampler *r = w->r;
    const int row = r->n_lights * LANES;
    const gsize n_from = r->near->lights.n;
    g_autofree float *slopes = g_new0(float, 2 * (gsize)r->n_views * (gsize)row);
    direction_mesh_slopes(r->to_views, made, row, slopes);
    for (gsize view = 0; view < r->near->views.n; view++) {
        struct resampler_from *sum = &sums->from[view];
        struct direction_share share;
        float value[LANES];
        direction_mesh_share(r->to_views, r->to_view_points, w->view_points + (gsize)(2 * view),
                             &r->back_views[view], &share);
        combine(&share, made, slopes, row, w->between);
        take_lights(w, view);
        direction_mesh_slopes(r->to_lights, w->between, LANES, w->slopes);
        for (gsize i = 0; i < n_from; i++) {
            const gsize at = (gsize)view * n_from + i;
            combine(&w->back_light_shares[i], w->between, w->slopes, LANES, value);
            if (was_measured(w, at))
                add_difference(value, w->values + at * LANES, &sum->back, &sum->back_norm);
        }
    }
}

static void add_weighted(const float *weights, int n, const float *values, gsize step, int row,
                         float *ret) {
    memset(ret, 0, sizeof(float) * (gsize)row);
    for (int i = 0; i < n; i++)
        for (int c = 0; weights[i] != 0 && c < row; c += LANES)
            *(lanes *)(ret + c) += weights[i] * *(const lanes *)(values + (gsize)i * step + c);
}

/* Returns the weights (n) that predict one direction from the others. */
static float *weights_without(const struct resampler_left_out *left, int n, const double *points,
                              const double *at) {
    struct direction_share share;
    float *weights = g_new0(float, n);
    direction_mesh_share(left->mesh, points, at, &left->guess, &share);
    direction_mesh_weights(left->mesh, &share, weights);
    return weights;
}

/* Predicts each view from the others (leave-one-out), and sums the squared differences. */
static void predict_views(struct texel_work *w, struct resampler_sums *sums) {
    const struct near_field *near = w->r->near;
    const int row = near->lights.n * LANES;
    g_autofree float *predicted = g_new0(float, row);
    for (gsize view = 0; view < near->views.n && near->views.n > 1; view++) {
        struct resampler_from *sum = &sums->from[view];
        const float *measured = w->values + (gsize)view * (gsize)row;
        g_autofree float *weights =
            weights_without(&w->r->left_views[view], near->views.n, w->view_points,
                            w->view_points + (gsize)(2 * view));
        add_weighted(weights, near->views.n, w->values, (gsize)row, row, predicted);
        for (gsize i = 0; i < near->lights.n; i++)
            if (was_measured(w, (gsize)view * near->lights.n + i))
                add_difference(predicted + i * LANES, measured + i * LANES, &sum->left_view,
                               &sum->left_view_norm);
    }
}

/* Predicts each light from the others (leave-one-out), and sums the squared differences. */
static void predict_lights(struct texel_work *w, struct resampler_sums *sums) {
    const struct near_field *near = w->r->near;
    const gsize n = near->lights.n;
    take_lights(w, 0);
    for (gsize light = 0; light < n && n > 1; light++) {
        g_autofree float *weights = weights_without(&w->r->left_lights[light], near->lights.n,
                                                    w->light_points, w->light_points + 2 * light);
        for (gsize view = 0; view < near->views.n; view++) {
            const float *values = w->values + (gsize)view * n * LANES;
            struct resampler_from *sum = &sums->from[view];
            float predicted[LANES];
            add_weighted(weights, near->lights.n, values, LANES, LANES, predicted);
            if (was_measured(w, (gsize)view * n + light))
                add_difference(predicted, values + light * LANES, &sum->left_light,
                               &sum->left_light_norm);
        }
    }
}

/* Returns the angle between `to` and the nearest of n directions, 2 asin(|a − b| / 2). */
static double moved_deg(struct vec3 to, const struct vec3 *from, int n) {
    double best = G_MAXDOUBLE;
    for (int i = 0; i < n; i++) {
        const struct vec3 difference = vec3_sub(to, from[i]);
        best = MIN(best, vec3_dot(difference, difference));
    }
    return 2 * asin(MIN(sqrt(best) / 2, 1)) / DEGREE;
}

/* Adds the angle between each target and the nearest measured direction, and for each target view
 * the share of its values beyond the limit of extrapolation. */
static void add_moved(const struct texel_work *w, struct resampler_sums *sums) {
    const struct resampler *r = w->r;
    g_autofree struct vec3 *lights = g_new0(struct vec3, r->near->lights.n);
    int clamped = 0;
    for (gsize i = 0; i < r->near->lights.n; i++)
        lights[i] = near_field_light(r->near, 0, i, w->texel);
    for (int i = 0; i < r->n_lights; i++) {
        const double moved = moved_deg(r->lights[i].direction, lights, r->near->lights.n);
        sums->light_moved_deg += moved / r->n_lights;
        sums->light_most_moved_deg = MAX(sums->light_most_moved_deg, moved);
        clamped += w->clamped[i];
    }
    for (int i = 0; i < r->n_views; i++) {
        struct resampler_to *sum = &sums->to[i];
        const double moved = moved_deg(r->views[i].direction, w->views, r->near->views.n);
        sum->moved_deg += moved;
        sum->max_moved_deg = MAX(sum->max_moved_deg, moved);
        sum->clamped += w->view_shares[i].clamped ? 1 : (double)clamped / r->n_lights;
    }
}

/* Adds the error of using the nominal directions without correction: measured minus corrected
 * values. This is possible only if the targets are the nominal directions (own). */
static void add_nominal(const struct texel_work *w, const float *made,
                        struct resampler_sums *sums) {
    const struct resampler *r = w->r;
    for (int view = 0; view < r->n_views; view++)
        for (int i = 0; i < r->n_lights; i++) {
            const gsize at = (gsize)view * (gsize)r->n_lights + (gsize)i;
            const float *value = made + at * LANES;
            if (r->own && !((int)value[COLOURS] & BTF_FLAG_HOLE) && was_measured(w, at))
                add_difference(w->values + at * LANES, value, &sums->to[view].nominal,
                               &sums->to[view].norm);
        }
}

static void begin(struct texel_work *w) {
    const struct resampler *r = w->r;
    const gsize n_views = r->near->views.n, n_lights = r->near->lights.n;
    const gsize most = MAX(n_views, (gsize)r->n_views) * MAX(n_lights, (gsize)r->n_lights);
    w->lights_of = -1;
    w->views = g_new0(struct vec3, n_views);
    w->view_points = g_new0(double, 2 * n_views);
    w->light_points = g_new0(double, 2 * n_lights);
    w->view_shares = g_new0(struct direction_share, r->n_views);
    w->light_shares = g_new0(struct direction_share, r->n_lights);
    w->back_light_shares = g_new0(struct direction_share, n_lights);
    w->clamped = g_new0(guint8, r->n_lights);
    w->values = g_new0(float, n_views *n_lights *LANES);
    w->between = g_new0(float, most *LANES);
    w->slopes = g_new0(float, 2 * most * LANES);
    for (gsize i = 0; i < r->near->views.n; i++) {
        w->views[i] = near_field_view(r->near, i, w->texel);
        direction_mesh_point(w->views[i], w->view_points + 2 * (gsize)i);
    }
    for (int i = 0; i < r->n_views; i++)
        direction_mesh_share(r->from_views, w->view_points, r->views[i].point, &r->views[i].guess,
                             &w->view_shares[i]);
}

static void end(struct texel_work *w) {
    g_free(w->views);
    g_free(w->view_points);
    g_free(w->light_points);
    g_free(w->view_shares);
    g_free(w->light_shares);
    g_free(w->back_light_shares);
    g_free(w->clamped);
    g_free(w->values);
    g_free(w->flags);
    g_free(w->between);
    g_free(w->slopes);
}

void resampler_texel(const struct resampler *r, int texel, const float *values, float *ret,
                     struct resampler_sums *sums) {
    struct texel_work w = {.r = r, .texel = texel};
    begin(&w);
    take_values(&w, values);
    forward(&w, ret);
    add_moved(&w, sums);
    add_nominal(&w, ret, sums);
    round_trip(&w, ret, sums);
    if (texel % r->left_step == 0) {
        predict_views(&w, sums);
        predict_lights(&w, sums);
        sums->sampled++;
    }
    sums->texels++;
    end(&w);
}
