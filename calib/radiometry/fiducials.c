/* Fiducials are white discs. The value of a pixel is divided by the value that white is expected to
 * have there, w = response · flat · cos θ · E / π (symbols as in radiometry.h).
 *
 * The pixel's share of white is s = (value − ground) / (level − ground), where ground is the value
 * of the surround and level is that of the disc. The centroid Σ s x / Σ s over the window, minus
 * the centroid of the projected disc, is the displacement of the fiducial. The mean value of the
 * interior gives the output of the lamp. */
#include "fiducials.h"

#include <string.h>

/* Radii around the centre of a fiducial, in units of its radius. */
#define WINDOW     1.4  /* the window of the centroid */
#define INNER      0.75 /* the white interior, which gives the level of white */
#define WHOLE      0.95 /* pixels wholly within this radius are used for the lamp's output */
#define RING       1.9  /* the surround lies between WINDOW and RING */
#define PASSES     12
#define FEW_PIXELS 6
#define FEW_WHOLE  12
#define CONTRAST   1.5 /* smallest ratio of white to surround */
/* relative standard deviation from which a fiducial counts as partly in shadow */
#define UNEVEN 0.1
/* Standard deviation of the share of white of a pixel at the edge of the disc. This share is not
 * exactly proportional to the covered area, because real pixels do not integrate evenly over their
 * area. */
#define EDGE_SHARE 0.12
/* Displacement of the centroid, in radii, divided by the first moment of the surround. It is
 * (WINDOW³ − 1) · 2/3 if the brightness varies in the window as it does in the ring. */
#define PULL     ((WINDOW * WINDOW * WINDOW - 1) * 2 / 3)
#define FARTHEST 1.0 /* largest distance from the expected position, in radii */
/* Bounds of the relative output of a lamp, as a fiducial shows it. If the output is outside, the
 * fiducial is in shadow, or something else was taken for the fiducial. */
#define MIN_OUTPUT 0.2
#define MAX_OUTPUT 5

/* Expected values are computed only at nodes, one every few pixels, and interpolated between them,
 * because this is much faster. A node has the point at which the pixel's ray meets the plane of the
 * fiducial's face, and the expected value of white there. */
/* Number of nodes along a picture's diagonal. With 20 % vignetting, the error of interpolation is
 * 1e-4. */
#define STEPS 64
struct node {
    /* x_mm and y_mm are in the rig frame. `white` is in DN per ms, without the factors of
     * find_colours(). */
    double x_mm, y_mm, white;
};

struct measuring {
    const struct fiducial_scene *scene;
    const struct rig_camera *camera;
    const struct rig_fiducial *fiducial;
    const char *cfa;
    const float *mosaic;
    const float *glare;      /* glare of red, green and blue pixels, in the unit of mosaic */
    struct vec3 eye, middle; /* rig frame; middle is the present estimate of the centre */
    int x0, x1, y0, y1;      /* range of pixels */
    struct node *nodes;
    int node_x0, node_y0, node_columns, node_rows, step;
    /* factor of expected white for each colour */
    double colour[3];
    /* values of white and of the surround, for each colour, relative to expected white */
    double level[3], ground[3];
    double moment[2]; /* first moment of the surround: mean of (share of white × direction) */
};

/* Returns the expected value of white in DN per ms, without the factors of find_colours(). p is the
 * point in the rig frame that the pixel (x, y) sees. */
static double white_at(const struct fiducial_scene *s, double x, double y, struct vec3 p) {
    const struct rig_camera *camera = &s->rig->cameras[s->camera];
    const struct rig_lamp *lamp = &s->rig->lamps[s->lamp];
    const struct vec3 path = vec3_sub(rig_lamp_position_mm(&s->rig->arc, lamp, s->arc_rad), p);
    return camera->response * radiometry_flat(camera, s->radiometry, x, y) / G_PI *
           MAX(path.z / vec3_length(path), 0) *
           rig_lamp_irradiance(&s->rig->arc, lamp, s->arc_rad, p) * 1e-3;
}

/* Computes the factors of expected white for the red, green and blue pixels: the products of the
 * fiducial's reflectance and the relative colours of camera and lamp. */
static void find_colours(const struct fiducial_scene *s, const struct rig_fiducial *fiducial,
                         double ret[3]) {
    for (int k = 0; k < 3; k++) {
        ret[k] = fiducial->reflectance[k];
        if (s->radiometry && s->radiometry->known)
            ret[k] *= s->radiometry->colour[k];
        if (s->lamp_radiometry && s->lamp_radiometry->known)
            ret[k] *= s->lamp_radiometry->colour[k];
    }
}

static void set_nodes(struct measuring *m) {
    m->node_x0 = m->x0;
    m->node_y0 = m->y0;
    m->step = CLAMP((int)hypot(m->camera->width, m->camera->height) / STEPS, 1, 8);
    m->node_columns = (m->x1 - m->x0) / m->step + 2;
    m->node_rows = (m->y1 - m->y0) / m->step + 2;
    m->nodes = g_new(struct node, (gsize)m->node_columns * (gsize)m->node_rows);
    for (int j = 0; j < m->node_rows; j++)
        for (int i = 0; i < m->node_columns; i++) {
            int x = m->node_x0 + i * m->step, y = m->node_y0 + j * m->step;
            struct vec3 ray = rig_pixel_ray(m->camera, x, y);
            struct vec3 p = vec3_add(m->eye, vec3_scale(ray, (m->middle.z - m->eye.z) / ray.z));
            m->nodes[j * m->node_columns + i] =
                (struct node){p.x, p.y, white_at(m->scene, x, y, p)};
        }
    find_colours(m->scene, m->fiducial, m->colour);
}

struct pixel {
    int colour;
    double from;     /* distance from the centre, in radii */
    double along[2]; /* unit direction from the centre; rig frame */
    double reach;    /* distance of the pixel's farthest corner from the centre, in radii */
    double value;    /* relative to expected white */
};

/* Computes a pixel by bilinear interpolation between nodes. Returns FALSE if the pixel is outside
 * of the range, expected to be dark, or not finite. */
static gboolean look_at(const struct measuring *m, int x, int y, struct pixel *ret) {
    int i = (x - m->node_x0) / m->step, j = (y - m->node_y0) / m->step;
    if (x < m->node_x0 || y < m->node_y0 || i + 1 >= m->node_columns || j + 1 >= m->node_rows)
        return FALSE;
    double u = (double)(x - m->node_x0) / m->step - i, v = (double)(y - m->node_y0) / m->step - j;
    const struct node *a = &m->nodes[j * m->node_columns + i], *b = a + m->node_columns;
    const double w[4] = {(1 - u) * (1 - v), u * (1 - v), (1 - u) * v, u * v};
    double x_mm = w[0] * a->x_mm + w[1] * a[1].x_mm + w[2] * b->x_mm + w[3] * b[1].x_mm;
    double y_mm = w[0] * a->y_mm + w[1] * a[1].y_mm + w[2] * b->y_mm + w[3] * b[1].y_mm;
    double white = w[0] * a->white + w[1] * a[1].white + w[2] * b->white + w[3] * b[1].white;
    ret->colour = radiometry_colour_at(m->cfa, x, y);
    double from_mm = hypot(x_mm - m->middle.x, y_mm - m->middle.y);
    ret->from = from_mm / m->fiducial->radius_mm;
    ret->along[0] = from_mm > 0 ? (x_mm - m->middle.x) / from_mm : 0;
    ret->along[1] = from_mm > 0 ? (y_mm - m->middle.y) / from_mm : 0;
    double side = hypot(a[1].x_mm - a->x_mm, a[1].y_mm - a->y_mm) +
                  hypot(b->x_mm - a->x_mm, b->y_mm - a->y_mm);
    ret->reach = ret->from + side / (2 * m->step * m->fiducial->radius_mm);
    white *= m->colour[ret->colour];
    if (!(white > 0))
        return FALSE;
    const float seen = m->mosaic[(gsize)y * (gsize)m->camera->width + (gsize)x];
    ret->value = (double)(seen - m->glare[ret->colour]) / white;
    return isfinite(ret->value);
}

static gboolean project(const struct measuring *m, double angle, double radii, double *x,
                        double *y) {
    double r = radii * m->fiducial->radius_mm;
    struct vec3 p = vec3_add(m->middle, vec3(r * cos(angle), r * sin(angle), 0));
    return rig_project(m->camera, p, x, y);
}

/* Computes the centroid (x̄, ȳ) of the projected disc as that of a polygon with the corners (xᵢ,
 * yᵢ) and the area A:
 *   A = ½ Σ (xᵢ yᵢ₊₁ − xᵢ₊₁ yᵢ),   x̄ = Σ (xᵢ + xᵢ₊₁)(xᵢ yᵢ₊₁ − xᵢ₊₁ yᵢ) / 6A.
 * Returns FALSE if a corner cannot be projected, or if A is 0. */
static gboolean expected_centroid(const struct measuring *m, double *ret_x, double *ret_y) {
    double area = 0, sx = 0, sy = 0, x0, y0, x1, y1;
    if (!project(m, 0, 1, &x0, &y0))
        return FALSE;
    double ox = x0, oy = y0; /* relative to the first point, to avoid cancellation */
    for (int i = 1; i <= 64; i++) {
        if (!project(m, i * 2 * G_PI / 64, 1, &x1, &y1))
            return FALSE;
        double cross = (x0 - ox) * (y1 - oy) - (x1 - ox) * (y0 - oy);
        area += cross;
        sx += cross * (x0 + x1 - 2 * ox);
        sy += cross * (y0 + y1 - 2 * oy);
        x0 = x1;
        y0 = y1;
    }
    *ret_x = ox + sx / (3 * area);
    *ret_y = oy + sy / (3 * area);
    return area != 0;
}

/* Sets the range of pixels to the part of the picture that encloses the circle with the radius
 * `ring`, in radii of the fiducial. Returns FALSE if the window exceeds the picture, or if the
 * circle cannot be projected. */
static gboolean set_bounds(struct measuring *m, double ring) {
    double low_x = HUGE_VAL, low_y = HUGE_VAL, high_x = -HUGE_VAL, high_y = -HUGE_VAL;
    for (int i = 0; i < 32; i++) {
        double x, y;
        if (!project(m, i * 2 * G_PI / 32, WINDOW, &x, &y) || x < 0 || y < 0 ||
            x > m->camera->width - 1 || y > m->camera->height - 1)
            return FALSE;
        if (!project(m, i * 2 * G_PI / 32, ring, &x, &y))
            return FALSE;
        low_x = MIN(low_x, x);
        high_x = MAX(high_x, x);
        low_y = MIN(low_y, y);
        high_y = MAX(high_y, y);
    }
    m->x0 = (int)MAX(floor(low_x), 0);
    m->y0 = (int)MAX(floor(low_y), 0);
    m->x1 = (int)MIN(ceil(high_x), m->camera->width - 1);
    m->y1 = (int)MIN(ceil(high_y), m->camera->height - 1);
    return TRUE;
}

struct mean {
    double n, sum, squares;
};

static void mean_add(struct mean *mean, double value) {
    mean->n++;
    mean->sum += value;
    mean->squares += value * value;
}

static double mean_of(const struct mean *mean) {
    return mean->n > 0 ? mean->sum / mean->n : 0;
}

static double variance_of(const struct mean *mean) {
    double middle = mean_of(mean);
    return mean->n > 1 ? MAX(mean->squares - mean->n * middle * middle, 0) / (mean->n - 1) : 0;
}

static double share_of_white(const struct measuring *m, const struct pixel *pixel) {
    double ground = m->ground[pixel->colour];
    return (pixel->value - ground) / (m->level[pixel->colour] - ground);
}

/* Measures the first moment of the surround. A surround that is brighter on one side displaces the
 * centroid. */
static void measure_moment(struct measuring *m) {
    struct pixel pixel;
    double n = 0;
    m->moment[0] = m->moment[1] = 0;
    for (int y = m->y0; y <= m->y1; y++)
        for (int x = m->x0; x <= m->x1; x++) {
            if (!look_at(m, x, y, &pixel) || pixel.from <= WINDOW || pixel.from >= RING)
                continue;
            double share = share_of_white(m, &pixel);
            m->moment[0] += share * pixel.along[0];
            m->moment[1] += share * pixel.along[1];
            n++;
        }
    for (int i = 0; i < 2 && n > 0; i++)
        m->moment[i] /= n;
}

/* Returns the squared displacement of the centroid by the surround, in px², or infinity if the
 * displaced centre cannot be projected. */
static double pull_variance(const struct measuring *m) {
    double r = PULL * m->fiducial->radius_mm, x0, y0, x1, y1;
    struct vec3 pulled = vec3_add(m->middle, vec3(r * m->moment[0], r * m->moment[1], 0));
    if (!rig_project(m->camera, m->middle, &x0, &y0) || !rig_project(m->camera, pulled, &x1, &y1))
        return (double)INFINITY;
    return (x1 - x0) * (x1 - x0) + (y1 - y0) * (y1 - y0);
}

/* Measures the levels of white and of the surround in each colour. whole gets the values of the
 * pixels that lie wholly in the disc. noise[0] gets the variance of the surround's pixels and
 * noise[1] that of white pixels, each divided by the squared contrast. Returns FALSE if there are
 * too few pixels, or too little contrast. */
static gboolean measure_levels(struct measuring *m, struct mean whole[3], double noise[2]) {
    struct mean white[3] = {{0}}, ground[3] = {{0}};
    struct pixel pixel;
    memset(whole, 0, 3 * sizeof *whole);
    for (int y = m->y0; y <= m->y1; y++)
        for (int x = m->x0; x <= m->x1; x++) {
            if (!look_at(m, x, y, &pixel))
                continue;
            if (pixel.reach < WHOLE)
                mean_add(&whole[pixel.colour], pixel.value);
            if (pixel.from < INNER)
                mean_add(&white[pixel.colour], pixel.value);
            else if (pixel.from > WINDOW && pixel.from < RING)
                mean_add(&ground[pixel.colour], pixel.value);
        }
    noise[0] = noise[1] = 0;
    double n = 0;
    for (int k = 0; k < 3; k++) {
        if (white[k].n == 0)
            continue;
        m->level[k] = mean_of(&white[k]);
        m->ground[k] = mean_of(&ground[k]);
        double contrast = m->level[k] - m->ground[k];
        if (white[k].n < 2 || ground[k].n < 2 || m->level[k] < CONTRAST * m->ground[k] ||
            !(contrast > 0))
            return FALSE;
        noise[0] += white[k].n * variance_of(&ground[k]) / (contrast * contrast);
        noise[1] += white[k].n * variance_of(&white[k]) / (contrast * contrast);
        n += white[k].n;
    }
    noise[0] /= MAX(n, 1);
    noise[1] /= MAX(n, 1);
    return n >= FEW_PIXELS;
}

/* Computes the centroid Σ s x / Σ s, where s is a pixel's share of white. Returns the area Σ s in
 * pixels. */
static double measure_centroid(const struct measuring *m, double *ret_x, double *ret_y) {
    double area = 0, sx = 0, sy = 0;
    struct pixel pixel;
    for (int y = m->y0; y <= m->y1; y++)
        for (int x = m->x0; x <= m->x1; x++) {
            if (!look_at(m, x, y, &pixel) || pixel.from > WINDOW)
                continue;
            double share = share_of_white(m, &pixel);
            area += share;
            sx += share * (x - m->x0);
            sy += share * (y - m->y0);
        }
    *ret_x = m->x0 + sx / area;
    *ret_y = m->y0 + sy / area;
    return area;
}

/* Returns the variance of each coordinate of the centroid x̄, Σ σ_s² |x − x̄|² / 2 / area². The sum
 * is over pixels x, and σ_s² is the variance of a pixel's share of white. */
static double centroid_variance(const struct measuring *m, const double noise[2], double area,
                                double middle_x, double middle_y) {
    double variance = 0;
    struct pixel pixel;
    for (int y = m->y0; y <= m->y1; y++)
        for (int x = m->x0; x <= m->x1; x++) {
            if (!look_at(m, x, y, &pixel) || pixel.from > WINDOW)
                continue;
            double share = CLAMP(share_of_white(m, &pixel), 0, 1);
            double own = noise[0] * (1 - share) + noise[1] * share;
            if (share > 0.1 && share < 0.9)
                own += EDGE_SHARE * EDGE_SHARE;
            double dx = x - middle_x, dy = y - middle_y;
            variance += own * (dx * dx + dy * dy) / 2;
        }
    return variance / (area * area);
}

/* Moves the estimated centre by a displacement in pixels. Returns FALSE if the centre is not
 * visible. */
static gboolean shift(struct measuring *m, double off_x, double off_y) {
    double x, y, z = m->middle.z;
    if (!rig_project(m->camera, m->middle, &x, &y))
        return FALSE;
    struct vec3 ray = rig_pixel_ray(m->camera, x + off_x, y + off_y);
    m->middle = vec3_add(m->eye, vec3_scale(ray, (z - m->eye.z) / ray.z));
    return TRUE;
}

/* Moves the estimate in steps from the expected position to the measured one. Then measures the
 * output of the lamp. Returns FALSE if the fiducial is not found, or if the output is not between
 * MIN_OUTPUT and MAX_OUTPUT. */
static gboolean follow(struct measuring *m, struct fiducial_seen *seen) {
    struct vec3 start = m->middle;
    struct mean whole[3];
    double noise[2], area = 0;
    for (int pass = 0; pass < PASSES; pass++) {
        double x, y;
        if (!set_bounds(m, RING) || !measure_levels(m, whole, noise))
            return FALSE;
        area = measure_centroid(m, &seen->x_px, &seen->y_px);
        if (!(area > FEW_PIXELS) || !expected_centroid(m, &x, &y))
            return FALSE;
        if (pass > 0 && hypot(seen->x_px - x, seen->y_px - y) < 0.01)
            break;
        if (!shift(m, seen->x_px - x, seen->y_px - y) ||
            vec3_length(vec3_sub(m->middle, start)) > FARTHEST * m->fiducial->radius_mm)
            return FALSE;
    }
    measure_moment(m);
    seen->error_px =
        sqrt(centroid_variance(m, noise, area, seen->x_px, seen->y_px) + pull_variance(m));
    /* The output of the lamp is the mean over all colours. Shot noise is nearly the same in all
     * pixels, so all colours share one variance. */
    double n = 0, freedom = 0, variance = 0, sum = 0;
    for (int k = 0; k < 3; k++) {
        n += whole[k].n;
        sum += whole[k].sum;
        freedom += MAX(whole[k].n - 1, 0);
        variance += variance_of(&whole[k]) * MAX(whole[k].n - 1, 0);
    }
    seen->output = n > 0 ? sum / n : 1;
    seen->output_error =
        n >= FEW_WHOLE && variance < UNEVEN * UNEVEN * freedom * seen->output * seen->output
            ? sqrt(variance / freedom / n)
            : (double)INFINITY;
    return isfinite(seen->error_px) && seen->output > MIN_OUTPUT && seen->output < MAX_OUTPUT;
}

int fiducials_measure(const struct fiducial_scene *scene, const char *cfa, const float *mosaic,
                      GArray *seen) {
    const struct rig_camera *camera = &scene->rig->cameras[scene->camera];
    float glare[3] = {0};
    double mean[3];
    int n = 0;
    if (scene->radiometry->glare > 0)
        radiometry_glare(scene->radiometry, cfa, camera->width, camera->height, mosaic, mean,
                         glare);
    for (int i = 0; i < scene->rig->n_fiducials; i++) {
        struct measuring m = {.scene = scene,
                              .camera = camera,
                              .fiducial = &scene->rig->fiducials[i],
                              .cfa = cfa,
                              .mosaic = mosaic,
                              .glare = glare};
        struct fiducial_seen found = {
            .camera = scene->camera, .fiducial = i, .turntable_rad = scene->turntable_rad};
        m.eye = rig_camera_centre_mm(m.camera);
        m.middle = rig_sample_point(scene->rig, scene->turntable_rad, m.fiducial->centre_mm);
        if (!expected_centroid(&m, &found.expected_x_px, &found.expected_y_px) ||
            !set_bounds(&m, RING + FARTHEST))
            continue;
        set_nodes(&m);
        if (follow(&m, &found)) {
            g_array_append_val(seen, found);
            n++;
        }
        g_free(m.nodes);
    }
    return n;
}

/* Green has twice the weight of red and of blue, because half of the pixels of a sensor with a
 * colour filter are green. */
double fiducials_white(const struct fiducial_scene *scene, int fiducial) {
    const struct rig_camera *camera = &scene->rig->cameras[scene->camera];
    const struct rig_fiducial *it = &scene->rig->fiducials[fiducial];
    const struct vec3 p = rig_sample_point(scene->rig, scene->turntable_rad, it->centre_mm);
    double x, y, colour[3];
    if (!rig_project(camera, p, &x, &y) || x < 0 || y < 0 || x > camera->width - 1 ||
        y > camera->height - 1)
        return 0;
    find_colours(scene, it, colour);
    return white_at(scene, x, y, p) * (colour[0] + 2 * colour[1] + colour[2]) / 4;
}

/* The weighted mean of the outputs o is Σ o/σ² / Σ 1/σ², and its standard error is 1 / √(Σ 1/σ²),
 * where σ is the standard error of an output. */
gboolean fiducials_output(const struct fiducial_seen *seen, int n, double *ret_output,
                          double *ret_error) {
    double sum = 0, weight = 0;
    for (int i = 0; i < n; i++) {
        if (!isfinite(seen[i].output_error))
            continue;
        double own = 1 / (seen[i].output_error * seen[i].output_error + 1e-12);
        sum += own * seen[i].output;
        weight += own;
    }
    *ret_output = weight > 0 ? sum / weight : 1;
    *ret_error = weight > 0 ? sqrt(1 / weight) : 0;
    return weight > 0;
}
