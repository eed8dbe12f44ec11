/* A mirror ball shows the direction of the light. With n the normal at the highlight and v the
 * direction to the camera, the light's direction is the reflection 2 (n·v) n − v. Each ball gives a
 * ray. Every pair of rays proposes a model: a common direction, or the point where they meet. The
 * model that most rays agree with is fitted by least squares. */
#include "ball_light.h"

#include <math.h>
#include <string.h>

#define PARALLEL 1e-9 /* relative determinant below which the rays are parallel */
/* a ray agrees within this number of standard deviations, or within AGREE_RAD */
#define AGREE     3.0
#define AGREE_RAD (0.5 * G_PI / 180)
#define NEAREST   3.0 /* smallest distance of a light from the balls, in radii */
/* largest error of a known position, relative to its distance from the ball */
#define KNOWN     0.5
#define CONE_RAYS 24 /* number of rays of the outline from which a ball is located */

/* Solves A x = b. If A has the rows r₀, r₁, r₂, its inverse has the columns r₁ × r₂, r₂ × r₀, r₀ ×
 * r₁, divided by det A. */
gboolean ball_light_solve(const struct mat3 *a, struct vec3 b, struct vec3 *ret) {
    struct vec3 r[3];
    for (int i = 0; i < 3; i++)
        r[i] = vec3(a->m[i][0], a->m[i][1], a->m[i][2]);
    struct vec3 c[3] = {vec3_cross(r[1], r[2]), vec3_cross(r[2], r[0]), vec3_cross(r[0], r[1])};
    double det = vec3_dot(r[0], c[0]), size = a->m[0][0] + a->m[1][1] + a->m[2][2];
    if (!(det > PARALLEL * size * size * size))
        return FALSE;
    *ret = vec3_scale(
        vec3_add(vec3_add(vec3_scale(c[0], b.x), vec3_scale(c[1], b.y)), vec3_scale(c[2], b.z)),
        1 / det);
    return TRUE;
}

static double angle_rad(struct vec3 a, struct vec3 b) {
    return atan2(vec3_length(vec3_cross(a, b)), vec3_dot(a, b));
}

/* Returns the unit direction of the ray through a point of the picture, away from the camera. */
static struct vec3 ray_through(const struct ball_camera *camera, double x_px, double y_px) {
    return vec3_unit(vec3((x_px - camera->x_px) / camera->focal_px,
                          (camera->y_px - y_px) / camera->focal_px, -1));
}

/* Computes the centre of a ball of radius 1 whose outline is a circle in the picture. The unit rays
 * r that touch the ball form a cone a · r = cos α. q = a / cos α solves r · q = 1 by least squares
 * over rays of the circle. The centre is q cos α / sin α. Returns FALSE if the rays determine no
 * such cone. */
static gboolean ball_centre(const struct ball_camera *camera, const struct ball_outline *ball,
                            struct vec3 *ret) {
    struct mat3 normal = {0};
    struct vec3 sum = vec3(0, 0, 0), q;
    for (int k = 0; k < CONE_RAYS; k++) {
        const double angle = 2 * G_PI * k / CONE_RAYS;
        const struct vec3 ray = ray_through(camera, ball->x_px + ball->radius_px * cos(angle),
                                            ball->y_px + ball->radius_px * sin(angle));
        const double r[3] = {ray.x, ray.y, ray.z};
        for (int i = 0; i < 9; i++)
            normal.m[i / 3][i % 3] += r[i / 3] * r[i % 3];
        sum = vec3_add(sum, ray);
    }
    if (!ball_light_solve(&normal, sum, &q))
        return FALSE;
    const double cosine = 1 / vec3_length(q), sine2 = 1 - cosine * cosine;
    if (!(sine2 > 0))
        return FALSE;
    *ret = vec3_scale(q, cosine / sqrt(sine2));
    return TRUE;
}

/* Computes the unit direction of the light whose highlight is at a point of the ball, and the
 * highlight's place in radii. Returns FALSE if the point is outside the ball, or if the ball cannot
 * be located. Without a focal length the normal is n = (x, y, √(1 − x² − y²)), with x and y
 * relative to the middle in radii, y up. With a focal length, the ray t r meets the ball of radius
 * 1 around c where |t r − c| = 1. */
static gboolean ball_light_direction(const struct ball_camera *camera,
                                     const struct ball_outline *ball, double x_px, double y_px,
                                     struct vec3 *ret_from, struct vec3 *ret) {
    struct vec3 normal, towards = vec3(0, 0, 1);
    if (camera->focal_px > 0) {
        const struct vec3 ray = ray_through(camera, x_px, y_px);
        struct vec3 centre;
        if (!ball_centre(camera, ball, &centre))
            return FALSE;
        const double along = vec3_dot(ray, centre);
        const double rest = 1 - vec3_dot(centre, centre) + along * along;
        if (!(rest > 0))
            return FALSE;
        *ret_from = vec3_scale(ray, along - sqrt(rest));
        normal = vec3_sub(*ret_from, centre);
        towards = vec3_scale(ray, -1);
    } else {
        const double x = (x_px - ball->x_px) / ball->radius_px;
        const double y = (ball->y_px - y_px) / ball->radius_px, rest = 1 - x * x - y * y;
        if (!(rest > 0))
            return FALSE;
        *ret_from = normal = vec3(x, y, sqrt(rest));
    }
    *ret = vec3_sub(vec3_scale(normal, 2 * vec3_dot(normal, towards)), towards);
    return TRUE;
}

/* A mirror ball maps equal areas of the picture to equal solid angles. The mean over the highlight
 * is therefore the mean over the lamp. Four points with the same second moments represent the
 * highlight. If one of the points is outside the ball, the direction at the centroid is returned
 * instead of the mean. */
gboolean ball_light_mean_direction(const struct ball_camera *camera,
                                   const struct ball_outline *ball, double x_px, double y_px,
                                   double xx_px2, double xy_px2, double yy_px2,
                                   struct vec3 *ret_from, struct vec3 *ret, double *ret_shift_rad) {
    const double x = sqrt(2 * xx_px2), skew = x > 0 ? 2 * xy_px2 / x : 0;
    const double y = sqrt(MAX(0, 2 * yy_px2 - skew * skew));
    const double points[4][2] = {{x, skew}, {-x, -skew}, {0, y}, {0, -y}};
    struct vec3 sum = vec3(0, 0, 0), middle, from, d;
    if (!ball_light_direction(camera, ball, x_px, y_px, ret_from, &middle))
        return FALSE;
    gboolean inside = TRUE;
    for (int k = 0; k < 4 && inside; k++) {
        inside =
            ball_light_direction(camera, ball, x_px + points[k][0], y_px + points[k][1], &from, &d);
        sum = vec3_add(sum, d);
    }
    *ret = inside ? vec3_unit(sum) : middle;
    *ret_shift_rad = angle_rad(*ret, middle);
    return TRUE;
}

gboolean ball_light_plate(const struct ball_camera *camera, const struct ball_outline *ball,
                          double x_px, double y_px, struct vec3 *ret) {
    struct vec3 centre;
    if (camera->focal_px == 0) {
        *ret =
            vec3((x_px - ball->x_px) / ball->radius_px, (ball->y_px - y_px) / ball->radius_px, -1);
        return TRUE;
    }
    if (!ball_centre(camera, ball, &centre))
        return FALSE;
    const struct vec3 ray = ray_through(camera, x_px, y_px);
    *ret = vec3_scale(ray, (centre.z - 1) / ray.z);
    return TRUE;
}

/* With p = from − middle, |p + t d| = radius at t = −p · d + √((p · d)² − |p|² + radius²). */
gboolean ball_light_on_sphere(struct vec3 from, struct vec3 direction, struct vec3 middle,
                              double radius, struct vec3 *ret) {
    const struct vec3 p = vec3_sub(from, middle);
    const double along = vec3_dot(p, direction), rest = radius * radius - vec3_dot(p, p);
    if (!(rest > 0))
        return FALSE;
    *ret = vec3_add(from, vec3_scale(direction, sqrt(along * along + rest) - along));
    return TRUE;
}

/* If the normal turns by an angle, the direction of the light turns by twice that angle. Let γ be
 * the angle between the normal and the direction to the camera. The distance of the highlight from
 * the middle of the ball is sin γ, in radii. An error of the highlight's position is therefore
 * divided by cos γ in the radial direction, and multiplied by cos γ in the tangential direction. */
double ball_light_sigma_rad(const struct ball_outline *ball, double circle_px, double x_px,
                            double y_px, double highlight_px) {
    const double sine = hypot(x_px - ball->x_px, y_px - ball->y_px) / ball->radius_px;
    const double cosine = sqrt(MAX(1 - sine * sine, 1e-6));
    const double middle = highlight_px * highlight_px + circle_px * circle_px;
    const double outwards = sqrt(middle + pow(sine * circle_px, 2)) / cosine;
    return 2 / ball->radius_px * hypot(outwards, cosine * sqrt(middle));
}

/* A hypothesis that rays may agree with: a position, or otherwise a direction. */
struct model {
    gboolean placed;
    struct vec3 direction, place;
};

/* Returns the angle between a ray and the direction from its ball that the model predicts. */
static double off_rad(const struct model *model, const struct ball_ray *ray) {
    return angle_rad(ray->direction,
                     model->placed ? vec3_sub(model->place, ray->from) : model->direction);
}

static struct vec3 mean_direction(const struct ball_ray *rays, int n, guint32 set) {
    struct vec3 sum = vec3(0, 0, 0);
    for (int i = 0; i < n; i++)
        if (set >> i & 1)
            sum = vec3_add(sum, rays[i].direction);
    return vec3_unit(sum);
}

/* Adds weight · (I − d dᵀ), the projection perpendicular to the ray, to a. */
static void add_across(struct mat3 *a, struct vec3 d, double weight) {
    const double v[3] = {d.x, d.y, d.z};
    for (int j = 0; j < 3; j++)
        for (int k = 0; k < 3; k++)
            a->m[j][k] += weight * ((j == k) - v[j] * v[k]);
}

/* Finds the point p closest to all rays of a set: Σ (I − d dᵀ) p = Σ (I − d dᵀ) q, where q are the
 * origins of the rays. Returns FALSE if the rays are parallel, or if p is less than NEAREST in
 * front of the origin of one of them. */
static gboolean meet(const struct ball_ray *rays, int n, guint32 set, struct mat3 *ret_normal,
                     struct vec3 *ret) {
    struct vec3 b = vec3(0, 0, 0);
    memset(ret_normal, 0, sizeof *ret_normal);
    for (int i = 0; i < n; i++) {
        if (!(set >> i & 1))
            continue;
        const struct ball_ray *r = &rays[i];
        add_across(ret_normal, r->direction, 1);
        b = vec3_add(b,
                     vec3_sub(r->from, vec3_scale(r->direction, vec3_dot(r->direction, r->from))));
    }
    if (!ball_light_solve(ret_normal, b, ret))
        return FALSE;
    for (int i = 0; i < n; i++)
        if (set >> i & 1 && vec3_dot(vec3_sub(*ret, rays[i].from), rays[i].direction) < NEAREST)
            return FALSE;
    return TRUE;
}

struct vote {
    struct model model;
    /* bit i is set if ray i agrees */
    guint32 set;
    int count;
    double misfit; /* sum of squared deviations of the rays, relative to their variances */
    gboolean tied; /* another set has as many rays */
};

/* Counts the rays that agree with a model, and replaces best if they are more. sigma_rad is the
 * standard deviation of the model. If another model has the same number of rays, the model with the
 * smaller misfit is kept. best->tied is set if the two models have different rays. */
static void vote(const struct ball_ray *rays, int n, const struct model *model, double sigma_rad,
                 struct vote *best) {
    struct vote mine = {.model = *model};
    for (int i = 0; i < n; i++) {
        const double off = off_rad(model, &rays[i]), sigma = hypot(rays[i].sigma_rad, sigma_rad);
        if (off > MAX(AGREE * sigma, AGREE_RAD))
            continue;
        mine.set |= 1U << i;
        mine.count++;
        mine.misfit += pow(off / sigma, 2);
    }
    if (mine.count < best->count)
        return;
    const gboolean differs = mine.count == best->count && mine.set != best->set;
    const gboolean tied = differs || (mine.count == best->count && best->tied);
    if (mine.count > best->count || mine.misfit < best->misfit)
        *best = mine;
    best->tied = tied;
}

/* Returns the standard error of a position, per axis: the square roots of the diagonal of N⁻¹ S
 * N⁻ᵀ, where N is the normal matrix (`normal`, of meet()) and S = Σ σ² (I − d dᵀ) / 2. d is the
 * direction of a ray, and σ its error at the position. */
static struct vec3 place_error(const struct ball_ray *rays, int n, guint32 set,
                               const struct mat3 *normal, struct vec3 place) {
    const struct vec3 unit[3] = {vec3(1, 0, 0), vec3(0, 1, 0), vec3(0, 0, 1)};
    struct mat3 spread = {0};
    double error[3] = {0};
    for (int i = 0; i < n; i++)
        if (set >> i & 1)
            add_across(&spread, rays[i].direction,
                       pow(vec3_length(vec3_sub(place, rays[i].from)) * rays[i].sigma_rad, 2) / 2);
    for (int k = 0; k < 3; k++) {
        struct vec3 row;
        if (ball_light_solve(normal, unit[k], &row))
            error[k] = sqrt(vec3_dot(row, mat3_mul_vec(&spread, row)));
    }
    return vec3(error[0], error[1], error[2]);
}

static void ball_light_place(const struct ball_ray *rays, int n, guint32 set,
                             struct ball_light *ret) {
    struct mat3 normal;
    int count = 0;
    ret->placed = meet(rays, n, set, &normal, &ret->place);
    if (!ret->placed)
        return;
    ret->place_error = place_error(rays, n, set, &normal, ret->place);
    for (int i = 0; i < n; i++)
        if (set >> i & 1) {
            const struct vec3 to = vec3_sub(ret->place, rays[i].from);
            ret->miss += pow(vec3_length(vec3_cross(to, rays[i].direction)), 2);
            ret->placed &= vec3_length(ret->place_error) < KNOWN * vec3_length(to);
            count++;
        }
    ret->miss = sqrt(ret->miss / count);
}

/* Computes the result and its errors from the set of rays that agree (bit i for ray i). If the rays
 * deviate by more than their standard deviations, the errors are multiplied by √(χ² per degree of
 * freedom). */
static void estimate(const struct ball_ray *rays, int n, guint32 set, struct ball_light *ret) {
    double squares = 0, misfit = 0, count = 0;
    ret->direction = mean_direction(rays, n, set);
    ball_light_place(rays, n, set, ret);
    const struct model model = {ret->placed, ret->direction, ret->place};
    for (int i = 0; i < n; i++) {
        ret->left_out[i] = !(set >> i & 1);
        ret->off_rad[i] = off_rad(&model, &rays[i]);
        if (ret->left_out[i])
            continue;
        squares += pow(rays[i].sigma_rad, 2);
        misfit += pow(ret->off_rad[i] / rays[i].sigma_rad, 2);
        count++;
    }
    const double freedom = count - (ret->placed ? 1.5 : 1);
    const double worse = freedom > 0 ? MAX(1, sqrt(misfit / freedom)) : 1;
    ret->sigma_rad = worse * sqrt(squares) / count;
    ret->place_error = vec3_scale(ret->place_error, worse);
}

gboolean ball_light_join(const struct ball_ray *rays, int n, struct ball_light *ret) {
    struct vote best = {.set = n == 1, .count = n == 1};
    memset(ret, 0, sizeof *ret);
    /* Try the mean direction and the intersection of every pair of rays. */
    for (int i = 0; i < n; i++)
        for (int j = i + 1; j < n; j++) {
            const guint32 pair = 1U << i | 1U << j;
            const double sigma = MAX(rays[i].sigma_rad, rays[j].sigma_rad);
            struct model model = {.direction = mean_direction(rays, n, pair)};
            struct mat3 normal;
            vote(rays, n, &model, sigma, &best);
            model.placed = meet(rays, n, pair, &normal, &model.place);
            if (model.placed)
                vote(rays, n, &model, sigma, &best);
        }
    if (2 * best.count > n && (best.count == n || !best.tied)) {
        estimate(rays, n, best.set, ret);
        return TRUE;
    }
    for (int i = 0; i < n; i++) {
        ret->off_rad[i] = G_PI;
        for (int j = 0; j < n; j++)
            if (j != i)
                ret->off_rad[i] =
                    MIN(ret->off_rad[i], angle_rad(rays[i].direction, rays[j].direction));
    }
    return FALSE;
}
