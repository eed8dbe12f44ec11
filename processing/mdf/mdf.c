/* The ray of a pixel is c + t r, with the camera's position c, the unit vector r and the range t.
 * It meets the sheet of light of its peak time at a range t (laser_lines_range_mm()). The value of
 * the MDF is the distance along the ray behind the reference plane: t − t₀ with t₀ = (z_ref − c_z)
 * / r_z. Each sweep gives up to two candidates per texel, which mdf_merge.c combines. */
#include "mdf.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/robust.h"
#include "frames/rectify.h"
#include "mdf_errors.h"

/* minimum sine of the angle between ray and sheet; below it, depths are noise */
#define MIN_ANGLE 0.03
/* Distances of two sweeps agree if they differ by at most TEXEL_SHARE of a texel, or by at most
 * FRAME_SHARE of the depth of one frame. The first tolerance is needed because the surface varies
 * within a texel. The second is needed because the peaks of the faintest lines are only known to a
 * tenth of a frame. */
#define TEXEL_SHARE 0.128
#define FRAME_SHARE 0.1
/* Limits of the position of a point (intersect()). A point is at most ABOVE units above the
 * reference plane, and at most BELOW units below the deepest structure. The unit is TEXEL_SHARE of
 * a texel, or FRAME_SHARE of the sheet's motion in a frame if this is larger. */
#define ABOVE 5
#define BELOW 10
/* minimum share, by weight, of the live pixels (struct phases) around a texel that have a peak */
#define SEEN_SHARE 0.75f
#define LIVE_SHARE 0.25 /* minimum number of peaks of a live phase, relative to the best phase */
/* height of a line, relative to the brightest one at a texel, that halves its weight */
#define FAINT 0.5
/* a candidate is kept if it continues the surface of at least this number of neighbouring texels */
#define CONFIRM 2
/* Distances that differ by at most CLOSE · agreement_mm lie on one surface. */
#define CLOSE        0.2f
#define MIN_TEXEL_PX 0.1 /* lower bound of the size of a texel in the picture, in pixels */
/* reach of mdf_shown(), as a multiple of the reach of the interpolation (struct phases); see
 * docs/lab/accuracy.md */
#define HIDDEN_REACH 2
/* minimum number of sweeps for add_hidden_errors(); with fewer, h of mdf_errors.h is uncertain */
#define HIDDEN_SWEEPS 8
/* if there are at least this many sweeps and they contradict each other, two of them must agree */
#define MANY_SWEEPS 4
/* value of MdfView.pixel_mm if the line lies above the reference plane */
#define OVER (-2.0f)
/* mdf_view_light() uses only pulses of at least this height, whose times are not dominated by
 * noise */
#define LIGHT_DN 100.0
/* mdf_view_light() measures the scatter only if the line is on average at least this many frames
 * wide, because narrower lines are not well sampled by the frames */
#define LIGHT_FRAMES 0.7
#define WIDTHS       50000 /* about this many pixels give the median width of a line */
#define EVERY        3     /* mdf_view_light() examines the scatter of every third texel */

/* What one sweep saw at a texel. */
struct seen {
    /* mm: distance along the texel's ray from the reference plane, below 0 if the sweep saw nothing
     * dn: height of the pulse in DN */
    float mm, dn;
    float shown; /* share of the pixels around the texel that saw a line (mdf_shown()) */
    float bend_mm[MDF_BENDS];
};

/* A sweep's laser, and the errors with which its sheet is known (take_known()). */
struct known {
    /* identifies the laser; all sweeps of a laser have the same errors */
    const struct rig_laser *laser;
    struct rig_laser copy;
    struct rig_laser_pose pose; /* of copy */
    gboolean has_errors;
    struct rig_sheet_errors errors;
};

struct MdfView {
    struct rig_camera camera;
    struct vec3 centre_mm;
    struct session_grid grid;
    int n_texels, n_sweeps;
    /* if the distances of adjacent pixels differ by more than this, they see different surfaces */
    float agreement_mm;
    float *ray; /* n_pixels × 3: unit vectors, rig frame */
    /* for each pixel, the distance along the ray from the camera to the reference plane */
    float *onset_mm;
    /* for each texel, the position of its centre in the picture; x < 0 if outside of the picture */
    float *x_px, *y_px;
    /* For each pixel, the distances that follow from the brightest and from the second pulse of a
     * sweep. −1 if there is no pulse; may be OVER. */
    float *pixel_mm[2];
    /* for each texel, the number of sweeps whose line lies above the reference plane */
    guint8 *over;
    struct seen *seen[MDF_MAX_SWEEPS]; /* n_texels × 2: brightest and second pulses */
    gboolean plain;                    /* see mdf_view_set_plain() */
    /* For each sweep:
     * weight        mdf_weight()
     * tolerance_mm  distance within which candidates agree with the mode (mdf_merge.h)
     * frame_mm      depth of a frame along the ray through the middle of the texels */
    double weight[MDF_MAX_SWEEPS], tolerance_mm[MDF_MAX_SWEEPS], frame_mm[MDF_MAX_SWEEPS];
    struct known known[MDF_MAX_SWEEPS];
    /* for each sweep, the median standard deviation of the line in frames; 0 if unknown */
    double line_frames[MDF_MAX_SWEEPS];
    /* for each sweep, the width of the line relative to its width on plates; 0 if unknown */
    double line_ratio[MDF_MAX_SWEEPS];
    double turntable_rad;
    /* covariance that mdf_view_set_sight() was given, converted to columns and rows of texels; 0 if
     * not set */
    double sight[2][2];
    double texel_mm;
    double texel_px[2]; /* pixels from one texel to the next, along rows and columns */
    int spacing_px;     /* spacing of the pixels that see the laser */
};

MdfView *mdf_view_new(const struct rig_camera *camera, double turntable_rad,
                      const struct session_grid *grid) {
    gsize n_pixels = (gsize)camera->width * camera->height;
    MdfView *view = g_new0(MdfView, 1);
    view->camera = *camera;
    view->turntable_rad = turntable_rad;
    view->centre_mm = rig_camera_centre_mm(camera);
    view->grid = *grid;
    view->n_texels = grid->width * grid->height;
    view->ray = g_new(float, n_pixels * 3);
    view->onset_mm = g_new(float, n_pixels);
    for (int rank = 0; rank < 2; rank++)
        view->pixel_mm[rank] = g_new(float, n_pixels);
    view->over = g_new0(guint8, view->n_texels);
    view->x_px = g_new(float, view->n_texels);
    view->y_px = g_new(float, view->n_texels);
    double slant = view->centre_mm.z / vec3_length(view->centre_mm);
    view->texel_mm = grid->width_mm / grid->width;
    view->agreement_mm = (float)(view->texel_mm / MAX(slant, 0.1));
    for (gsize i = 0; i < n_pixels; i++) {
        struct vec3 ray = rig_pixel_ray(camera, (int)(i % camera->width), (int)(i / camera->width));
        view->ray[3 * i] = (float)ray.x;
        view->ray[3 * i + 1] = (float)ray.y;
        view->ray[3 * i + 2] = (float)ray.z;
        view->onset_mm[i] = (float)((grid->reference_mm - view->centre_mm.z) / ray.z);
    }
    for (int i = 0; i < view->n_texels; i++) {
        int row = i / grid->width, column = i % grid->width;
        struct vec3 p = rectify_point_mm(grid, column + 0.5, row + 0.5);
        double x, y;
        gboolean inside = rig_project(camera, rig_turn(p, turntable_rad), &x, &y) && x >= 0 &&
                          y >= 0 && x <= camera->width - 1 && y <= camera->height - 1;
        view->x_px[i] = inside ? (float)x : -1;
        view->y_px[i] = inside ? (float)y : -1;
    }
    view->spacing_px = 1;
    for (int axis = 0; axis < 2; axis++) {
        const double column = 0.5 * (grid->width - !axis), row = 0.5 * (grid->height - axis);
        double x[2] = {0}, y[2] = {0};
        gboolean shown = TRUE;
        for (int k = 0; k < 2; k++) {
            const struct vec3 p = rectify_point_mm(grid, column + k * !axis, row + k * axis);
            shown &= rig_project(camera, rig_turn(p, turntable_rad), &x[k], &y[k]);
        }
        /* A minimum applies, because texels far smaller than pixels do not give more accuracy. */
        view->texel_px[axis] = shown ? MAX(hypot(x[1] - x[0], y[1] - y[0]), MIN_TEXEL_PX) : 1;
    }
    return view;
}

/* Sets sight to K V Kᵀ in the middle of the grid. V is px2. K is the inverse of the derivative of a
 * texel's position in the picture with respect to its column and row. Changes nothing if K does not
 * exist. */
void mdf_view_set_sight(MdfView *view, const double px2[2][2]) {
    const double middle[2] = {0.5 * view->grid.width, 0.5 * view->grid.height};
    double at[3][2], k[2][2];
    for (int i = 0; i < 3; i++) {
        const struct vec3 p =
            rectify_point_mm(&view->grid, middle[0] + (i == 1), middle[1] + (i == 2));
        if (!rig_project(&view->camera, rig_turn(p, view->turntable_rad), &at[i][0], &at[i][1]))
            return;
    }
    const double a = at[1][0] - at[0][0], b = at[2][0] - at[0][0];
    const double c = at[1][1] - at[0][1], d = at[2][1] - at[0][1], det = a * d - b * c;
    if (!(fabs(det) > 1e-9))
        return;
    k[0][0] = d / det, k[0][1] = -b / det, k[1][0] = -c / det, k[1][1] = a / det;
    for (int i = 0; i < 2; i++)
        for (int j = 0; j < 2; j++) {
            view->sight[i][j] = 0;
            for (int u = 0; u < 2; u++)
                for (int v = 0; v < 2; v++)
                    view->sight[i][j] += k[i][u] * px2[u][v] * k[j][v];
        }
}

void mdf_view_free(MdfView *view) {
    if (!view)
        return;
    for (int i = 0; i < view->n_sweeps; i++)
        g_free(view->seen[i]);
    g_free(view->ray);
    g_free(view->onset_mm);
    for (int rank = 0; rank < 2; rank++)
        g_free(view->pixel_mm[rank]);
    g_free(view->over);
    g_free(view->x_px);
    g_free(view->y_px);
    g_free(view);
}

/* Returns |s · (c × e)| / 6, with three positions relative to the near end of the laser's line: s
 * of the laser's source, c of the camera, and e of the far end of the line. */
double mdf_weight(const struct rig_arc *arc, const struct rig_laser *laser, double arc_rad,
                  struct vec3 camera_mm) {
    struct vec3 centre = vec3(0, 0, 0), up = vec3(0, 0, 1);
    double sweep_rad = rig_laser_sweep_rad(arc, laser, arc_rad, centre);
    struct vec3 line = vec3_cross(rig_laser_sheet(arc, laser, arc_rad, sweep_rad).normal, up);
    if (!(vec3_length(line) > 1e-9))
        return 0;
    struct vec3 a = vec3_unit(line), b = vec3_scale(a, -1);
    struct vec3 source = vec3_sub(rig_laser_position_mm(arc, laser, arc_rad), a);
    struct vec3 camera = vec3_sub(camera_mm, a), along = vec3_sub(b, a);
    return fabs(vec3_dot(source, vec3_cross(camera, along))) / 6;
}

/* Returns the distance in mm by which the sheet moves in one frame: step · R, with the angle of a
 * step and the range R from the laser's source to the middle of the texels. ret_along_mm receives
 * the depth of a frame along the ray r to this point: step · R / |n·r|, with the sheet's normal
 * n. */
static double mdf_frame_mm(const MdfView *view, const struct laser_sweep *sweep,
                           double *ret_along_mm) {
    const struct vec3 middle = vec3(0, 0, view->grid.reference_mm);
    const struct vec3 ray = vec3_unit(vec3_sub(middle, view->centre_mm));
    const struct vec3 source = rig_laser_position_mm(sweep->arc, sweep->laser, sweep->arc_rad);
    const double sweep_rad = rig_laser_sweep_rad(sweep->arc, sweep->laser, sweep->arc_rad, middle);
    const struct rig_plane sheet =
        rig_laser_sheet(sweep->arc, sweep->laser, sweep->arc_rad, sweep_rad);
    const double sine = MAX(fabs(vec3_dot(sheet.normal, ray)), MIN_ANGLE);
    const double frame_mm =
        MAX(fabs(sweep->step_rad) * vec3_length(vec3_sub(middle, source)), 1e-9);
    *ret_along_mm = frame_mm / sine;
    return frame_mm;
}

/* Returns the distance along a pixel's ray from the reference plane to the sheet at a peak time.
 * height_mm is the unit of ABOVE and BELOW.
 * - A point above the plane by less than ABOVE has the distance 0.
 * - The result is OVER if the point is higher, but by less than the size of the sample.
 * - The result is −1 if the point is higher still, or below the structure by more than BELOW.
 * - The result is also −1 if there is no line, if the ray does not go downwards, or if ray and
 *   sheet intersect at too small an angle. */
static float intersect(const MdfView *view, const struct laser_sheets *sheets, double height_mm,
                       float peak, gsize pixel) {
    if (!(peak >= 0) || !isfinite(peak))
        return -1;
    const float *r = view->ray + 3 * pixel;
    struct vec3 ray = vec3(r[0], r[1], r[2]);
    if (!(ray.z < 0))
        return -1;
    double range = laser_lines_range_mm(sheets, peak, view->centre_mm, ray, MIN_ANGLE);
    double height = view->centre_mm.z + range * ray.z - view->grid.reference_mm;
    if (height >= ABOVE * height_mm && height < MAX(view->grid.width_mm, view->grid.height_mm))
        return OVER;
    if (!(height < ABOVE * height_mm) || !(height > -view->grid.depth_mm - BELOW * height_mm))
        return -1;
    return (float)MAX(range - view->onset_mm[pixel], 0);
}

/* A phase is a place in the 2 × 2 colour filter. A phase is live if its pixels see the laser: all
 * four are live, or only those of the laser's colour. */
struct phases {
    gboolean live[4];
    int radius; /* maximum distance in pixels from a pixel to the next live one */
};

static int phase_of(int x, int y) {
    return 2 * (y & 1) + (x & 1);
}

/* Intersects the rays of all pixels with the sheets of their peaks (pixel_mm), and finds the
 * live phases. */
static struct phases find_phases(MdfView *view, const struct laser_sweep *sweep, double height_mm) {
    const struct laser_sheets sheets = laser_lines_sheets(sweep);
    struct phases phases = {.radius = 1};
    int seen[4] = {0}, most = 0, width = view->camera.width;
    for (gsize i = 0; i < (gsize)width * (gsize)view->camera.height; i++) {
        view->pixel_mm[0][i] = intersect(view, &sheets, height_mm, sweep->peak[i], i);
        if (sweep->second_peak)
            view->pixel_mm[1][i] = intersect(view, &sheets, height_mm, sweep->second_peak[i], i);
        seen[phase_of((int)i % width, (int)i / width)] += view->pixel_mm[0][i] >= 0;
    }
    for (int k = 0; k < 4; k++)
        most = MAX(most, seen[k]);
    for (int k = 0; k < 4; k++) {
        phases.live[k] = seen[k] > LIVE_SHARE * most;
        phases.radius = phases.live[k] ? phases.radius : 2;
    }
    return phases;
}

/* A pixel near a texel, with distances and heights of its brightest and its second pulse. mm < 0
 * if there is no pulse. */
struct near {
    int x, y;
    float mm[2], dn[2];
    float share; /* bilinear weight */
    gboolean taken[2];
};

struct nears {
    struct near near[16];
    int n;
    /* all: sum of the weights of all live pixels
     * seen: sum over the live pixels with a peak
     * over: sum over the live pixels whose point is above the reference plane (OVER) */
    float all, seen, over;
};

static float brightness(const float *dn, gsize pixel) {
    return dn && isfinite(dn[pixel]) ? MAX(dn[pixel], 0) : 0;
}

/* Collects the live pixels within phases->radius around (x, y) with their bilinear weights. */
static void find_near(const MdfView *view, const struct phases *phases,
                      const struct laser_sweep *sweep, float x, float y, struct nears *ret) {
    int r = phases->radius, i = (int)floorf(x), j = (int)floorf(y);
    *ret = (struct nears){.n = 0};
    for (int v = j - r + 1; v <= j + r; v++)
        for (int u = i - r + 1; u <= i + r; u++) {
            float share = (1 - fabsf(x - u) / r) * (1 - fabsf(y - v) / r);
            if (u < 0 || v < 0 || u >= view->camera.width || v >= view->camera.height ||
                !phases->live[phase_of(u, v)] || share <= 0)
                continue;
            gsize pixel = (gsize)v * (gsize)view->camera.width + (gsize)u;
            struct near *near = &ret->near[ret->n++];
            near->mm[0] = view->pixel_mm[0][pixel];
            near->mm[1] = sweep->second_peak ? view->pixel_mm[1][pixel] : -1;
            near->dn[0] = brightness(sweep->intensity, pixel);
            near->dn[1] = brightness(sweep->second_intensity, pixel);
            near->share = share;
            near->x = u;
            near->y = v;
            ret->all += share;
            ret->seen += near->mm[0] >= 0 ? share : 0;
            ret->over += near->mm[0] == OVER ? share : 0;
        }
}

/* Returns the index of the pixel's pulse, not taken yet, whose distance is closest to mm within
 * agreement_mm. Returns −1 if there is none. */
static int next_to(const MdfView *view, const struct near *near, float mm) {
    int next = -1;
    float least = view->agreement_mm;
    for (int rank = 0; rank < 2; rank++) {
        float off = fabsf(near->mm[rank] - mm);
        if (near->mm[rank] >= 0 && !near->taken[rank] && off <= least) {
            next = rank;
            least = off;
        }
    }
    return next;
}

/* A surface that some of the near pixels see: its distance, the height of its pulse in DN, and the
 * sum of the weights of these pixels. */
struct side {
    float mm, dn, share;
};

/* Finds the surface that near pixels with the largest sum of weights see, and marks their pulses as
 * taken. A surface is the set of pulses, at most one of each near pixel, that agree with the pulse
 * of one near pixel. Its distance is the weighted mean of these pulses, or −1 if there is no pulse
 * left. On a tie, a surface around a brightest pulse goes before one around a second pulse. */
static struct side take_side(const MdfView *view, struct nears *all) {
    struct side best = {.mm = -1};
    float centre = -1;
    for (int i = 0; i < 2 * all->n; i++) {
        const int rank = i / all->n;
        const float mm = all->near[i % all->n].mm[rank];
        struct side side = {0};
        if (mm < 0 || all->near[i % all->n].taken[rank])
            continue;
        for (int k = 0; k < all->n; k++) {
            const struct near *near = &all->near[k];
            const int next = next_to(view, near, mm);
            if (next < 0)
                continue;
            side.mm += near->share * near->mm[next];
            side.dn += near->share * near->dn[next];
            side.share += near->share;
        }
        if (side.share > best.share * 1.001f) {
            best = (struct side){side.mm / side.share, side.dn / side.share, side.share};
            centre = mm;
        }
    }
    for (int k = 0; k < all->n && centre >= 0; k++) {
        int rank = next_to(view, &all->near[k], centre);
        if (rank >= 0)
            all->near[k].taken[rank] = TRUE;
    }
    return best;
}

/* Returns the distance of the pixel's pulse that is closest to mm, or NAN if the pixel has no
 * pulse. */
static float closest_to(const MdfView *view, const struct laser_sweep *sweep, int x, int y,
                        float mm) {
    if (x < 0 || y < 0 || x >= view->camera.width || y >= view->camera.height)
        return NAN;
    const gsize pixel = (gsize)y * (gsize)view->camera.width + (gsize)x;
    const float first = view->pixel_mm[0][pixel];
    const float second = sweep->second_peak ? view->pixel_mm[1][pixel] : -1;
    const gboolean behind = second >= 0 && (first < 0 || fabsf(second - mm) < fabsf(first - mm));
    const float found = behind ? second : first;
    return found >= 0 ? found : NAN;
}

/* Computes the bends (mdf_errors.h) of the surface at the distance mm around the near pixel with
 * the largest weight, over one and two spacings of the live pixels. A bend is NAN if one of its
 * three pixels has no pulse. */
static void find_bends(const MdfView *view, const struct laser_sweep *sweep, int spacing_px,
                       const struct nears *nears, float mm, float ret_mm[MDF_BENDS]) {
    const struct near *middle = &nears->near[0];
    for (int i = 1; i < nears->n; i++)
        if (nears->near[i].share > middle->share)
            middle = &nears->near[i];
    const float here = closest_to(view, sweep, middle->x, middle->y, mm);
    for (int k = 0; k < MDF_BENDS; k++) {
        const int by = spacing_px * (k / 2 + 1), dx = k % 2 ? 0 : by, dy = k % 2 ? by : 0;
        const float before = closest_to(view, sweep, middle->x - dx, middle->y - dy, mm);
        const float after = closest_to(view, sweep, middle->x + dx, middle->y + dy, mm);
        ret_mm[k] = 0.5f * (before + after) - here;
    }
}

/* Returns the share of the live pixels around (x, y) that saw a line. Their weights are a tent
 * that reaches HIDDEN_REACH times as far as the tent of the interpolation. */
static float mdf_shown(const MdfView *view, const struct phases *phases, float x, float y) {
    const int r = HIDDEN_REACH * phases->radius, i = (int)floorf(x), j = (int)floorf(y);
    const int width = view->camera.width, height = view->camera.height;
    float all = 0, seen = 0;
    for (int v = MAX(j - r + 1, 0); v <= MIN(j + r, height - 1); v++)
        for (int u = MAX(i - r + 1, 0); u <= MIN(i + r, width - 1); u++) {
            const float share = MAX(1 - fabsf(x - u) / r, 0) * MAX(1 - fabsf(y - v) / r, 0);
            if (!phases->live[phase_of(u, v)])
                continue;
            all += share;
            seen += view->pixel_mm[0][v * width + u] >= 0 ? share : 0;
        }
    return all > 0 ? seen / all : 0;
}

/* Stores the standard errors with which turn and roll of the sheet are known. If no line was found
 * in the reference region, they are the errors k of the calibration. A line there measures both
 * angles a second time, with the error e. The stored error is then that of the weighted mean, 1 /
 * √(1 / k² + 1 / e²). If the line contradicts the calibration, the stored error is e. */
static void take_known(struct known *known, const struct laser_sweep *sweep) {
    const struct laser_lines *lines = sweep->lines;
    *known = (struct known){
        .laser = sweep->laser, .copy = *sweep->laser, .has_errors = sweep->errors != NULL};
    known->pose = rig_laser_pose(sweep->arc, &known->copy, sweep->arc_rad);
    if (!sweep->errors)
        return;
    known->errors = *sweep->errors;
    if (!lines || !lines->turn_rad || !isfinite(lines->roll_error_rad))
        return;
    double(*c)[RIG_SHEET_PARAMETERS] = known->errors.covariance;
    const double range_mm = vec3_length(lines->source_mm);
    const double turn[2] = {sqrt(c[RIG_SHEET_OFFSET][RIG_SHEET_OFFSET]) / range_mm,
                            lines->offset_error_rad};
    const double roll[2] = {sqrt(c[RIG_SHEET_ALONG][RIG_SHEET_ALONG]), lines->roll_error_rad};
    double factor[RIG_SHEET_PARAMETERS];
    for (int i = 0; i < RIG_SHEET_PARAMETERS; i++) {
        const double *of = i == RIG_SHEET_ALONG ? roll : turn;
        const double mean = lines->disagrees ? of[1] : of[1] * of[0] / hypot(of[0], of[1]);
        factor[i] = i == RIG_SHEET_BEND || !(of[0] > 0) ? 1 : mean / of[0];
    }
    for (int i = 0; i < RIG_SHEET_PARAMETERS; i++)
        for (int k = 0; k < RIG_SHEET_PARAMETERS; k++)
            c[i][k] *= factor[i] * factor[k];
}

/* Returns the median of the line's standard deviation in frames, over pixels that see the
 * sample, or 0 if it is unknown. */
static double mdf_line_frames(const MdfView *view, const struct laser_sweep *sweep) {
    const int n = view->camera.width * view->camera.height, step = 1 + n / WIDTHS;
    g_autofree double *frames = g_new(double, n / step + 1);
    int known = 0;
    for (int i = 0; i < n && sweep->width; i += step)
        if (view->pixel_mm[0][i] >= 0 && sweep->width[i] > 0 && isfinite(sweep->width[i]))
            frames[known++] = (double)sweep->width[i];
    return known > 0 ? robust_median(frames, known) : 0;
}

int mdf_view_add(MdfView *view, const struct laser_sweep *sweep) {
    g_return_val_if_fail(view->n_sweeps < MDF_MAX_SWEEPS, 0);
    double along_mm;
    const double frame_mm = mdf_frame_mm(view, sweep, &along_mm);
    const double texel_mm = TEXEL_SHARE * view->texel_mm;
    /* The tolerance of heights follows from the distance by which the sheet moves in a frame. The
     * depth of a frame along the ray is not used, because for sweeps with a low height resolution
     * it would accept points far outside of the sample. */
    struct phases phases = find_phases(view, sweep, MAX(texel_mm, FRAME_SHARE * frame_mm));
    struct seen *texels = g_new(struct seen, 2 * view->n_texels);
    int seen = 0;
    for (int i = 0; i < view->n_texels; i++) {
        struct nears near = {.n = 0};
        struct side side[2] = {{.mm = -1}, {.mm = -1}};
        if (view->x_px[i] >= 0)
            find_near(view, &phases, sweep, view->x_px[i], view->y_px[i], &near);
        view->over[i] += near.over > SEEN_SHARE * near.all;
        /* At a depth edge, the near pixels see two surfaces. The texel lies on the surface with
         * more weight, and only the pulses of that surface are averaged. A second surface is a
         * second candidate if at least SEEN_SHARE of the pixels see it too; the other laser
         * positions decide between the two. If too few pixels saw the laser, there is no
         * candidate. */
        if (near.n > 0 && !(near.seen < SEEN_SHARE * near.all))
            for (int k = 0; k < 2; k++)
                side[k] = take_side(view, &near);
        if (!(side[1].share >= SEEN_SHARE * near.all))
            side[1] = (struct side){.mm = -1};
        const float shown =
            side[0].mm >= 0 ? mdf_shown(view, &phases, view->x_px[i], view->y_px[i]) : 0;
        for (int k = 0; k < 2; k++) {
            texels[2 * i + k] = (struct seen){.mm = side[k].mm, .dn = side[k].dn, .shown = shown};
            if (side[k].mm >= 0)
                find_bends(view, sweep, phases.radius, &near, side[k].mm,
                           texels[2 * i + k].bend_mm);
        }
        seen += texels[2 * i].mm >= 0;
    }
    view->spacing_px = MAX(view->spacing_px, phases.radius);
    view->tolerance_mm[view->n_sweeps] = MAX(texel_mm, FRAME_SHARE * along_mm);
    view->frame_mm[view->n_sweeps] = along_mm;
    take_known(&view->known[view->n_sweeps], sweep);
    view->line_frames[view->n_sweeps] = mdf_line_frames(view, sweep);
    view->line_ratio[view->n_sweeps] =
        sweep->line_rad > 0
            ? view->line_frames[view->n_sweeps] * fabs(sweep->step_rad) / sweep->line_rad
            : 0;
    view->weight[view->n_sweeps] =
        mdf_weight(sweep->arc, sweep->laser, sweep->arc_rad, view->centre_mm);
    view->seen[view->n_sweeps++] = texels;
    return seen;
}

/* Collects the candidates of a texel from all laser positions, and returns their number. The weight
 * of a candidate is mdf_weight · b² / (b² + FAINT²), where b is the height of its pulse divided by
 * that of the brightest candidate of the texel. Much fainter lines graze the surface, or are
 * reflections.
 *
 * For the plain mean, only the brightest pulse of each sweep is collected, with the weight
 * mdf_weight. */
static int collect(const MdfView *view, int texel, struct mdf_candidate *ret) {
    float most = 0;
    int n = 0;
    for (int s = 0; s < view->n_sweeps; s++)
        for (int rank = 0; rank < (view->plain ? 1 : 2); rank++) {
            const struct seen *seen = &view->seen[s][2 * texel + rank];
            if (seen->mm < 0 || !(view->weight[s] > 0))
                continue;
            most = MAX(most, seen->dn);
            ret[n] = (struct mdf_candidate){.mm = seen->mm,
                                            .dn = seen->dn,
                                            .shown = seen->shown,
                                            .tolerance_mm = (float)view->tolerance_mm[s],
                                            .frame_mm = (float)view->frame_mm[s],
                                            .sweep = s};
            memcpy(ret[n++].bend_mm, seen->bend_mm, sizeof seen->bend_mm);
        }
    for (int i = 0; i < n; i++) {
        const double bright = most > 0 ? ret[i].dn / most : 1;
        ret[i].weight = view->weight[ret[i].sweep];
        if (!view->plain)
            ret[i].weight *= bright * bright / (bright * bright + FAINT * FAINT);
    }
    return n;
}

/* Returns Σ ((a + b) / 2 − m)², where m is a texel's distance, and a and b are the distances of two
 * opposite neighbours. The sum is over the up to four pairs of neighbours of which both distances
 * are known. ret_pairs[0] receives the number of these pairs, and ret_pairs[1] the number of the
 * other pairs within the grid. */
static double bends_mm2(const MdfView *view, const float *distance, int texel, int ret_pairs[2]) {
    static const struct { int right, down; } pairs[] = {{1, 0}, {0, 1}, {1, 1}, {1, -1}};
    const int width = view->grid.width, height = view->grid.height;
    const int column = texel % width, row = texel / width;
    double squares = 0;
    ret_pairs[0] = ret_pairs[1] = 0;
    for (gsize k = 0; k < G_N_ELEMENTS(pairs); k++) {
        const int right = pairs[k].right, down = pairs[k].down;
        if (column < right || column + right >= width || row < abs(down) ||
            row + abs(down) >= height)
            continue;
        const double a = distance[texel - down * width - right];
        const double b = distance[texel + down * width + right];
        const gboolean known = a >= 0 && b >= 0;
        ret_pairs[!known]++;
        squares += known ? pow(0.5 * (a + b) - distance[texel], 2) : 0;
    }
    return squares;
}

/* Returns the mean of the squares that bends_mm2() sums, or −1 if there is no pair. If texels have
 * the noise σ, the mean is 1.5 σ² on a plane. At a step it is about (step / 2)². */
static double roughness_mm2(const MdfView *view, const float *distance, int texel) {
    int pairs[2];
    const double squares = bends_mm2(view, distance, texel, pairs);
    return pairs[0] > 0 ? squares / pairs[0] : -1;
}

/* Sets the standard errors of texels whose distance comes from one sweep. The squared error is (r²
 * + median of r² over the view) / 1.5, where r² is the texel's roughness_mm2(). The median is added
 * because r² may be small by chance. If a texel has no pair of opposite neighbours with known
 * distances, the error is agreement_mm, the largest step between texels of one surface. */
static void find_lone_errors(const MdfView *view, const float *distance, const float *sweeps,
                             float *error_mm) {
    g_autofree double *rough = g_new(double, view->n_texels);
    g_autofree double *known = g_new(double, view->n_texels);
    int n = 0;
    for (int i = 0; i < view->n_texels; i++) {
        rough[i] = distance[i] >= 0 ? roughness_mm2(view, distance, i) : -1;
        if (rough[i] >= 0)
            known[n++] = rough[i];
    }
    const double typical = n > 0 ? robust_median(known, n) : 0;
    for (int i = 0; i < view->n_texels; i++)
        if (sweeps[i] == 1)
            error_mm[i] =
                rough[i] >= 0 ? (float)sqrt((rough[i] + typical) / 1.5) : view->agreement_mm;
}

/* Adds part 3 of mdf_errors.h: h s² is added to the squared error of each texel. s² is the mean
 * over the texel's pairs of opposite neighbours. If both neighbours are known, the pair gives 4 b²,
 * because a step next to the texel makes a bend b of half its height (bends_mm2()). If a neighbour
 * is unknown, its depth may be anything between the texel's distance m and that of the deepest
 * texel; the pair then gives (deepest − m)² / 3. */
static void add_hidden_errors(const MdfView *view, const float *distance,
                              const struct mdf_spread *spreads, float *error_mm) {
    float deepest = 0;
    if (view->n_sweeps < HIDDEN_SWEEPS)
        return;
    for (int i = 0; i < view->n_texels; i++)
        deepest = MAX(deepest, distance[i]);
    for (int i = 0; i < view->n_texels; i++) {
        int pairs[2];
        if (spreads[i].n < 2 || !(spreads[i].hidden > 0))
            continue;
        const double steps = 4 * bends_mm2(view, distance, i, pairs) +
                             pairs[1] * pow((double)(deepest - distance[i]), 2) / 3;
        const double step_mm2 = steps / MAX(pairs[0] + pairs[1], 1);
        error_mm[i] = (float)sqrt(pow((double)error_mm[i], 2) + spreads[i].hidden * step_mm2);
    }
}

/* The part of a texel's error that comes from the calibration. */
struct known_share {
    double sheets_mm2; /* variance caused by errors of the sheets */
    /* Σ w dt/dx, with the ranges t to the sheets and their weights w: change of the mean range from
     * one column to the next, and from one row to the next */
    double by_texel[2];
};

/* Returns the vector from the camera to the point of the reference plane at a column and row, in
 * the rig frame. */
static struct vec3 way_to(const MdfView *view, double column, double row) {
    const struct vec3 p = rectify_point_mm(&view->grid, column + 0.5, row + 0.5);
    return vec3_sub(rig_turn(p, view->turntable_rad), view->centre_mm);
}

/* Computes the calibration's part of the error of a texel. samples are the n candidates that were
 * merged to the distance mm. If a sheet with the normal n is displaced by δ along n, its point on a
 * ray r moves by δ / (n·r). The merged distance moves by Σ w δ / (n·r), where w are the weights,
 * with the sum 1.
 *
 * All sweeps of a laser have the same errors e, with the covariance C, and δ = j·e with the lever j
 * of the sweep. The levers of a laser add up to g = Σ w j / (n·r). The variance is the sum of gᵀ C
 * g over the lasers. */
static struct known_share share_known(const MdfView *view, int texel,
                                      const struct mdf_candidate *samples, int n, double mm) {
    struct known_share share = {0};
    const int column = texel % view->grid.width, row = texel / view->grid.width;
    const struct vec3 way = way_to(view, column, row), ray = vec3_unit(way);
    const struct vec3 from_eye = vec3_add(way, vec3_scale(ray, mm));
    const struct vec3 point = vec3_add(view->centre_mm, from_eye);
    struct {
        const struct known *known;
        double lever[RIG_SHEET_PARAMETERS];
    } lasers[RIG_MAX_LASERS] = {{NULL, {0}}};
    struct vec3 rays[2][2];
    double weights = 0;
    int n_lasers = 0;
    for (int axis = 0; axis < 2; axis++)
        for (int k = 0; k < 2; k++)
            rays[axis][k] = vec3_unit(
                way_to(view, column + (axis ? 0 : 2 * k - 1), row + (axis ? 2 * k - 1 : 0)));
    for (int i = 0; i < n; i++)
        weights += samples[i].weight;
    for (int i = 0; i < n; i++) {
        const struct known *known = &view->known[samples[i].sweep];
        const double w = samples[i].weight / weights;
        const double sweep_rad = rig_laser_pose_sweep_rad(&known->pose, point) +
                                 rig_laser_pose_bent_rad(&known->pose, point);
        const struct vec3 normal = rig_laser_pose_sheet(&known->pose, sweep_rad).normal;
        const double sine = vec3_dot(normal, ray), apart = vec3_dot(normal, from_eye);
        double lever[RIG_SHEET_PARAMETERS];
        int k = 0;
        if (!(fabs(sine) > MIN_ANGLE))
            continue;
        for (int axis = 0; axis < 2; axis++)
            share.by_texel[axis] +=
                w * apart / 2 *
                (1 / vec3_dot(normal, rays[axis][1]) - 1 / vec3_dot(normal, rays[axis][0]));
        if (!known->has_errors)
            continue;
        while (k < n_lasers && lasers[k].known->laser != known->laser)
            k++;
        if (k == RIG_MAX_LASERS)
            continue;
        n_lasers = MAX(n_lasers, k + 1);
        lasers[k].known = known;
        rig_laser_pose_lever(&known->pose, point, lever);
        for (int j = 0; j < RIG_SHEET_PARAMETERS; j++)
            lasers[k].lever[j] += w * lever[j] / sine;
    }
    for (int k = 0; k < n_lasers; k++)
        for (int a = 0; a < RIG_SHEET_PARAMETERS; a++)
            for (int b = 0; b < RIG_SHEET_PARAMETERS; b++)
                share.sheets_mm2 += lasers[k].lever[a] * lasers[k].known->errors.covariance[a][b] *
                                    lasers[k].lever[b];
    return share;
}

/* Returns the range of the surface along a texel's ray, or NAN if it is unknown. */
static double mdf_range_mm(const MdfView *view, const float *distance, int column, int row) {
    if (column < 0 || row < 0 || column >= view->grid.width || row >= view->grid.height ||
        !(distance[row * view->grid.width + column] >= 0))
        return NAN;
    return vec3_length(way_to(view, column, row)) +
           (double)distance[row * view->grid.width + column];
}

/* Adds the calibration's part to the standard errors. If the camera sees the sample x texels away
 * from the assumed position, two ranges along the assumed ray change: the ranges t to the sheets by
 * x dt/dx, and the range s of the surface by x ds/dx. The error of the distance is the difference
 * of these changes. */
static void add_known_errors(const MdfView *view, const float *distance,
                             const struct known_share *shares, float *error_mm) {
    for (int i = 0; i < view->n_texels; i++) {
        const int column = i % view->grid.width, row = i / view->grid.width;
        double variance = shares[i].sheets_mm2, off[2];
        if (!(distance[i] >= 0) || !(error_mm[i] >= 0))
            continue;
        for (int axis = 0; axis < 2; axis++) {
            const int right = !axis, down = axis;
            const double here = mdf_range_mm(view, distance, column, row);
            const double before = mdf_range_mm(view, distance, column - right, row - down);
            const double after = mdf_range_mm(view, distance, column + right, row + down);
            const double slope = isfinite(before) && isfinite(after) ? (after - before) / 2
                                 : isfinite(after)                   ? after - here
                                 : isfinite(before)                  ? here - before
                                                                     : 0;
            off[axis] = shares[i].by_texel[axis] - slope;
        }
        for (int a = 0; a < 2; a++)
            for (int b = 0; b < 2; b++)
                variance += off[a] * view->sight[a][b] * off[b];
        error_mm[i] = (float)sqrt(pow((double)error_mm[i], 2) + MAX(variance, 0));
    }
}

/* Keeps only the candidates that continue the surface of at least CONFIRM neighbours. Moves them to
 * the front and returns their number. */
static int keep_continuing(const MdfView *view, const float *sure, int texel,
                           struct mdf_candidate *candidates, int n) {
    const int width = view->grid.width, height = view->grid.height;
    int kept = 0;
    for (int c = 0; c < n; c++) {
        int agree = 0;
        for (int k = 0; k < 9; k++) {
            const int column = texel % width + k % 3 - 1, row = texel / width + k / 3 - 1;
            if (column < 0 || row < 0 || column >= width || row >= height)
                continue;
            const float near = sure[row * width + column];
            agree += near >= 0 && fabsf(near - candidates[c].mm) <= CLOSE * view->agreement_mm;
        }
        if (agree >= CONFIRM)
            candidates[kept++] = candidates[c];
    }
    return kept;
}

void mdf_view_set_plain(MdfView *view) {
    view->plain = TRUE;
}

void mdf_view_merge(const MdfView *view, float *ret_distance, float *ret_n, float *ret_error) {
    struct mdf_candidate candidates[2 * MDF_MAX_SWEEPS];
    const int least = view->n_sweeps >= MANY_SWEEPS ? 2 : 1;
    g_autofree float *sure = g_new(float, view->n_texels);
    g_autofree struct mdf_spread *spreads = g_new0(struct mdf_spread, view->n_texels);
    g_autofree struct known_share *shares = g_new0(struct known_share, view->n_texels);
    for (int i = 0; i < view->n_texels; i++) {
        int n = collect(view, i, candidates);
        struct mdf_merged merged =
            view->plain ? mdf_merge_mean(candidates, n) : mdf_merge(candidates, n, least);
        if (merged.n > 0)
            shares[i] = share_known(view, i, candidates, merged.n, (double)merged.mm);
        sure[i] = ret_distance[i] = merged.mm;
        ret_n[i] = (float)merged.n;
        ret_error[i] = -1;
        spreads[i] = merged.spread;
    }
    /* For texels on which too few laser positions agree, the candidates that continue the surface
     * of their neighbours are merged. If no candidate does so and only one sweep saw the texel, the
     * brightest pulse of that sweep is used, because nothing contradicts it. */
    for (int i = 0; i < view->n_texels; i++) {
        if (sure[i] >= 0)
            continue;
        int n = collect(view, i, candidates);
        const gboolean alone = n > 0 && candidates[0].sweep == candidates[n - 1].sweep;
        const struct mdf_candidate first = candidates[0];
        n = keep_continuing(view, sure, i, candidates, n);
        if (n == 0 && alone)
            candidates[n++] = first;
        struct mdf_merged merged = mdf_merge(candidates, n, 1);
        if (merged.n > 0)
            shares[i] = share_known(view, i, candidates, merged.n, (double)merged.mm);
        ret_distance[i] = merged.mm;
        ret_n[i] = (float)merged.n;
        spreads[i] = merged.spread;
    }
    const struct mdf_errors_grid grid = {
        view->grid.width,
        view->grid.height,
        {view->spacing_px / view->texel_px[0], view->spacing_px / view->texel_px[1]}};
    mdf_errors_find(&grid, spreads, ret_error);
    add_hidden_errors(view, ret_distance, spreads, ret_error);
    find_lone_errors(view, ret_distance, ret_n, ret_error);
    add_known_errors(view, ret_distance, shares, ret_error);
}

/* The scatter at a texel is √u: the standard deviation, in frames, of the times of the line
 * (mdf_errors.h). ret->scatter is its median over the texels, divided by the mean standard
 * deviation of the line in frames (line_frames). */
void mdf_view_light(const MdfView *view, struct mdf_light *ret) {
    struct mdf_candidate candidates[2 * MDF_MAX_SWEEPS];
    g_autofree double *scatter = g_new(double, view->n_texels / EVERY + 1);
    double widths = 0, frames = 0;
    int n_widths = 0, n_frames = 0, n_scatter = 0;
    *ret = (struct mdf_light){0};
    for (int s = 0; s < view->n_sweeps; s++) {
        widths += view->line_ratio[s];
        n_widths += view->line_ratio[s] > 0;
        frames += view->line_frames[s];
        n_frames += view->line_frames[s] > 0;
    }
    for (int i = 0; i < view->n_texels; i += EVERY) {
        const int n = collect(view, i, candidates);
        const struct mdf_merged merged = mdf_merge(candidates, n, 2);
        double dn = 0;
        for (int k = 0; k < merged.n; k++)
            dn += (double)candidates[k].dn / merged.n;
        if (merged.spread.freedom > 0 && dn > LIGHT_DN)
            scatter[n_scatter++] = sqrt(merged.spread.frames2);
    }
    if (n_widths > 0)
        ret->width = widths / n_widths;
    if (n_frames > 0 && n_scatter > 0 && frames > LIGHT_FRAMES * n_frames)
        ret->scatter = robust_median(scatter, n_scatter) * n_frames / frames;
}

/* Merges the candidates that do not agree with the accepted distance. */
void mdf_view_other(const MdfView *view, const float *distance, float *ret_other) {
    struct mdf_candidate candidates[2 * MDF_MAX_SWEEPS];
    for (int i = 0; i < view->n_texels; i++) {
        int n = collect(view, i, candidates), kept = 0;
        for (int k = 0; k < n; k++)
            if (!(distance[i] >= 0) ||
                fabsf(candidates[k].mm - distance[i]) > CLOSE * view->agreement_mm)
                candidates[kept++] = candidates[k];
        ret_other[i] = mdf_merge(candidates, kept, 1).mm;
    }
}

int mdf_view_above(const MdfView *view, const float *distance) {
    const int least = view->n_sweeps >= MANY_SWEEPS ? 2 : 1;
    int n = 0;
    for (int i = 0; i < view->n_texels; i++)
        n += distance[i] < 0 && view->over[i] >= least;
    return n;
}
