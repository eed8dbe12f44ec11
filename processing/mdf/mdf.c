/* A pixel's ray c + t r meets the sheet of light of its peak time at t (laser_lines_range_mm());
 * the MDF value is its distance t − t₀ along the ray behind the reference plane, t₀ = (z_ref − c_z)
 * / r_z. Each sweep gives up to two candidates a texel, which mdf_merge.c combines. */
#include "mdf.h"

#include <math.h>
#include <stdlib.h>
#include <string.h>

#include "base/robust.h"
#include "frames/rectify.h"
#include "mdf_errors.h"

#define LEAST_ANGLE 0.03 /* least sine of the angle between ray and sheet: below it, noise */
/* Two sweeps' distances this close agree: a share of a texel, since the surface varies within it,
 * or of the depth of a sweep's frame, to a tenth of which the faintest lines' peaks are known. */
#define TEXEL_SHARE 0.128
#define FRAME_SHARE 0.1
/* In these tolerances: how far points may lie above the reference plane and below the structure. */
#define ABOVE          5
#define BELOW          10
#define SEEN_SHARE     0.75f /* share of the pixels around a texel that must see the line */
#define LIVE_SHARE     0.25  /* of the peaks in the best phase of the colour filter */
#define FAINT          0.5   /* of the brightest line at a texel: such a line has half weight */
#define CONFIRM        2     /* neighbouring texels that must have the same distance */
#define CLOSE          0.2f  /* factor of the agreement tolerance for smooth continuation */
#define LEAST_TEXEL_PX 0.1   /* for errors' sake */
#define HIDDEN_REACH   2     /* of mdf_shown(); chosen: docs/accuracy.md */
#define HIDDEN_SWEEPS  8 /* least for mdf_add_hidden_errors(): of fewer, shadows say too little */
#define MANY_SWEEPS    4 /* from this number of sweeps on, one is not believed against others */

/* What a sweep saw of a texel. */
struct seen {
    float mm, dn; /* mm < 0: nothing */
    float shown;  /* share of the pixels around that saw a line (mdf_shown()) */
    float bend_mm[MDF_BENDS];
};

struct MdfView {
    struct rig_camera camera;
    struct vec3 centre_mm;
    struct session_grid grid;
    int n_texels, n_sweeps;
    float agreement_mm; /* adjacent pixels whose distances differ more see different surfaces */
    float *ray;         /* n_pixels × 3: unit vectors, rig frame */
    float *onset_mm; /* n_pixels: distance along the ray from the centre to the reference plane */
    float *x_px, *y_px; /* n_texels: projected centres; x < 0: outside of the picture */
    float *pixel_mm[2]; /* n_pixels, one sweep: by the brightest, second pulse; −1: none */
    struct seen *seen[MDF_MAX_SWEEPS]; /* n_texels × 2: brightest and second pulses */
    double weight[MDF_MAX_SWEEPS], tolerance_mm[MDF_MAX_SWEEPS], frame_mm[MDF_MAX_SWEEPS];
    double texel_mm;
    double texel_px[2]; /* from a texel to the next one, along rows and columns */
    int spacing_px;     /* of pixels that see the laser */
};

MdfView *mdf_view_new(const struct rig_camera *camera, double turntable_rad,
                      const struct session_grid *grid) {
    gsize n_pixels = (gsize)camera->width * camera->height;
    MdfView *view = g_new0(MdfView, 1);
    view->camera = *camera;
    view->centre_mm = rig_camera_centre_mm(camera);
    view->grid = *grid;
    view->n_texels = grid->width * grid->height;
    view->ray = g_new(float, n_pixels * 3);
    view->onset_mm = g_new(float, n_pixels);
    for (int rank = 0; rank < 2; rank++)
        view->pixel_mm[rank] = g_new(float, n_pixels);
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
        /* Texels far smaller than pixels are not worth more. */
        view->texel_px[axis] = shown ? MAX(hypot(x[1] - x[0], y[1] - y[0]), LEAST_TEXEL_PX) : 1;
    }
    return view;
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
    g_free(view->x_px);
    g_free(view->y_px);
    g_free(view);
}

/* |s · (c × e)| / 6, with s, c, e: source, camera, far end of the line relative to its near end. */
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

/* Depth of a frame: at a range R from the source the sheet moves by step · R, which is returned,
 * and by step · R / |n·r| along a ray r (ret_along_mm), here that through the texels' middle. */
static double mdf_frame_mm(const MdfView *view, const struct laser_sweep *sweep,
                           double *ret_along_mm) {
    const struct vec3 middle = vec3(0, 0, view->grid.reference_mm);
    const struct vec3 ray = vec3_unit(vec3_sub(middle, view->centre_mm));
    const struct vec3 source = rig_laser_position_mm(sweep->arc, sweep->laser, sweep->arc_rad);
    const double sweep_rad = rig_laser_sweep_rad(sweep->arc, sweep->laser, sweep->arc_rad, middle);
    const struct rig_plane sheet =
        rig_laser_sheet(sweep->arc, sweep->laser, sweep->arc_rad, sweep_rad);
    const double sine = MAX(fabs(vec3_dot(sheet.normal, ray)), LEAST_ANGLE);
    const double frame_mm =
        MAX(fabs(sweep->step_rad) * vec3_length(vec3_sub(middle, source)), 1e-9);
    *ret_along_mm = frame_mm / sine;
    return frame_mm;
}

/* Distance along a pixel's ray from the reference plane to the sheet at a peak time; −1: no line,
 * a grazing intersection, or a point outside of the volume. */
static float intersect(const MdfView *view, const struct laser_sweep *sweep, double height_mm,
                       float peak, gsize pixel) {
    if (!(peak >= 0) || !isfinite(peak))
        return -1;
    const float *r = view->ray + 3 * pixel;
    struct vec3 ray = vec3(r[0], r[1], r[2]);
    if (!(ray.z < 0))
        return -1;
    double range = laser_lines_range_mm(sweep, peak, view->centre_mm, ray, LEAST_ANGLE);
    double height = view->centre_mm.z + range * ray.z - view->grid.reference_mm;
    if (!(height < ABOVE * height_mm) || !(height > -view->grid.depth_mm - BELOW * height_mm))
        return -1;
    return (float)MAX(range - view->onset_mm[pixel], 0);
}

/* The phases of the 2 × 2 colour filter that see the laser: all, or those of its colour. */
struct phases {
    gboolean live[4];
    int radius; /* largest distance in pixels to the next live one */
};

static int phase_of(int x, int y) {
    return 2 * (y & 1) + (x & 1);
}

/* Intersects the pixels' rays with their peaks' sheets (pixel_mm), and finds the live phases. */
static struct phases find_phases(MdfView *view, const struct laser_sweep *sweep, double height_mm) {
    struct phases phases = {.radius = 1};
    int seen[4] = {0}, most = 0, width = view->camera.width;
    for (gsize i = 0; i < (gsize)width * (gsize)view->camera.height; i++) {
        view->pixel_mm[0][i] = intersect(view, sweep, height_mm, sweep->peak[i], i);
        if (sweep->second_peak)
            view->pixel_mm[1][i] = intersect(view, sweep, height_mm, sweep->second_peak[i], i);
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

/* A pixel near a texel: distances and heights of its brightest and second pulse; mm < 0: none. */
struct near {
    int x, y;
    float mm[2], dn[2];
    float share; /* bilinear weight */
    gboolean taken[2];
};

struct nears {
    struct near near[16];
    int n;
    float all, seen; /* summed weights of all live pixels, and of those with a peak */
};

static float brightness(const float *dn, gsize pixel) {
    return dn && isfinite(dn[pixel]) ? MAX(dn[pixel], 0) : 0;
}

/* Collects the live pixels within the filter's radius around (x, y) with their bilinear weights. */
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
        }
}

/* Index of the pixel's distance closest to mm within the tolerance; −1: none, or already taken. */
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

/* One surface that some of the near pixels see. */
struct side {
    float mm, dn, share;
};

/* Takes the surface with the largest weight of near pixels out of the set; on a tie, that of the
 * brightest pulses. It is the weighted mean of the near pixels that agree with one of them. */
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

/* The distance of a pixel's pulse that is the closest to mm; NAN: it has none. */
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

/* Bends of the surface at mm around the pixel of most weight, over one and two live spacings. */
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

/* Share of the live pixels around (x, y) that saw a line. Their weight is that of a tent which
 * reaches HIDDEN_REACH times as far as that of the interpolation. */
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

int mdf_view_add(MdfView *view, const struct laser_sweep *sweep) {
    g_return_val_if_fail(view->n_sweeps < MDF_MAX_SWEEPS, 0);
    double along_mm;
    const double frame_mm = mdf_frame_mm(view, sweep, &along_mm);
    const double texel_mm = TEXEL_SHARE * view->texel_mm;
    /* Not along the ray, or sweeps of low height resolution put points far outside the sample. */
    struct phases phases = find_phases(view, sweep, MAX(texel_mm, FRAME_SHARE * frame_mm));
    struct seen *texels = g_new(struct seen, 2 * view->n_texels);
    int seen = 0;
    for (int i = 0; i < view->n_texels; i++) {
        struct nears near = {.n = 0};
        struct side side[2] = {{.mm = -1}, {.mm = -1}};
        if (view->x_px[i] >= 0)
            find_near(view, &phases, sweep, view->x_px[i], view->y_px[i], &near);
        /* At a depth edge the near pixels see two surfaces. The texel lies on the one with more
         * weight, whose pixels alone are averaged; the other is a second candidate: other laser
         * positions decide. If too few pixels saw the laser, it has none. */
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
    view->weight[view->n_sweeps] =
        mdf_weight(sweep->arc, sweep->laser, sweep->arc_rad, view->centre_mm);
    view->seen[view->n_sweeps++] = texels;
    return seen;
}

/* Candidates of a texel from all laser positions, of weight mdf_weight · b² / (b² + FAINT²), b:
 * pulse height over the brightest. Much fainter lines graze the surface, or are reflections. */
static int mdf_collect(const MdfView *view, int texel, struct mdf_candidate *ret) {
    float most = 0;
    int n = 0;
    for (int s = 0; s < view->n_sweeps; s++)
        for (int rank = 0; rank < 2; rank++) {
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
        double bright = most > 0 ? ret[i].dn / most : 1;
        ret[i].weight =
            view->weight[ret[i].sweep] * bright * bright / (bright * bright + FAINT * FAINT);
    }
    return n;
}

/* Σ ((a + b) / 2 − m)² of a texel's distance m and opposite neighbours' a and b, over the (up to
 * four) pairs that have both. ret_pairs: how many have both; how many in the grid do not. */
static double mdf_bends_mm2(const MdfView *view, const float *distance, int texel,
                            int ret_pairs[2]) {
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

/* Their mean: on a plane 1.5 σ² of a texel's noise, at a step about (step / 2)²; −1: no pair. */
static double mdf_roughness_mm2(const MdfView *view, const float *distance, int texel) {
    int pairs[2];
    const double squares = mdf_bends_mm2(view, distance, texel, pairs);
    return pairs[0] > 0 ? squares / pairs[0] : -1;
}

/* Standard errors of what one sweep alone saw: their squares are (r² + median r² of the view) /
 * 1.5, r² being a texel's roughness, which may be small by chance. Without neighbours it is the
 * largest step from texel to texel that one surface takes. */
static void mdf_find_lone_errors(const MdfView *view, const float *distance, const float *sweeps,
                                 float *error_mm) {
    g_autofree double *rough = g_new(double, view->n_texels);
    g_autofree double *known = g_new(double, view->n_texels);
    int n = 0;
    for (int i = 0; i < view->n_texels; i++) {
        rough[i] = distance[i] >= 0 ? mdf_roughness_mm2(view, distance, i) : -1;
        if (rough[i] >= 0)
            known[n++] = rough[i];
    }
    const double typical = n > 0 ? robust_median(known, n) : 0;
    for (int i = 0; i < view->n_texels; i++)
        if (sweeps[i] == 1)
            error_mm[i] =
                rough[i] >= 0 ? (float)sqrt((rough[i] + typical) / 1.5) : view->agreement_mm;
}

/* mdf_errors.h, 3. A step beside a texel bends the line through opposite neighbours by half of its
 * height, so s² is 4 b² of their bends b; where a neighbour is not known, (deepest − m)² / 3, as it
 * may lie as deep as the deepest texel, or anywhere between. */
static void mdf_add_hidden_errors(const MdfView *view, const float *distance,
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
        const double steps = 4 * mdf_bends_mm2(view, distance, i, pairs) +
                             pairs[1] * pow((double)(deepest - distance[i]), 2) / 3;
        const double step_mm2 = steps / MAX(pairs[0] + pairs[1], 1);
        error_mm[i] = (float)sqrt(pow((double)error_mm[i], 2) + spreads[i].hidden * step_mm2);
    }
}

/* Keeps candidates that continue the surface of CONFIRM neighbours or more. Returns how many. */
static int mdf_keep_continuing(const MdfView *view, const float *sure, int texel,
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

void mdf_view_merge(const MdfView *view, float *ret_distance, float *ret_n, float *ret_error) {
    struct mdf_candidate candidates[2 * MDF_MAX_SWEEPS];
    const int least = view->n_sweeps >= MANY_SWEEPS ? 2 : 1;
    g_autofree float *sure = g_new(float, view->n_texels);
    g_autofree struct mdf_spread *spreads = g_new0(struct mdf_spread, view->n_texels);
    for (int i = 0; i < view->n_texels; i++) {
        int n = mdf_collect(view, i, candidates);
        struct mdf_merged merged = mdf_merge(candidates, n, least);
        sure[i] = ret_distance[i] = merged.mm;
        ret_n[i] = (float)merged.n;
        ret_error[i] = -1;
        spreads[i] = merged.spread;
    }
    /* Where too few laser positions agree, candidates that continue the surface around count. If
     * there are none, a single sweep's brightest is believed, as nothing contradicts it. */
    for (int i = 0; i < view->n_texels; i++) {
        if (sure[i] >= 0)
            continue;
        int n = mdf_collect(view, i, candidates);
        const gboolean alone = n > 0 && candidates[0].sweep == candidates[n - 1].sweep;
        const struct mdf_candidate first = candidates[0];
        n = mdf_keep_continuing(view, sure, i, candidates, n);
        if (n == 0 && alone)
            candidates[n++] = first;
        struct mdf_merged merged = mdf_merge(candidates, n, 1);
        ret_distance[i] = merged.mm;
        ret_n[i] = (float)merged.n;
        spreads[i] = merged.spread;
    }
    const struct mdf_errors_grid grid = {
        view->grid.width,
        view->grid.height,
        {view->spacing_px / view->texel_px[0], view->spacing_px / view->texel_px[1]}};
    mdf_errors_find(&grid, spreads, ret_error);
    mdf_add_hidden_errors(view, ret_distance, spreads, ret_error);
    mdf_find_lone_errors(view, ret_distance, ret_n, ret_error);
}

/* Merges the candidates that do not agree with the accepted distance. */
void mdf_view_other(const MdfView *view, const float *distance, float *ret_other) {
    struct mdf_candidate candidates[2 * MDF_MAX_SWEEPS];
    for (int i = 0; i < view->n_texels; i++) {
        int n = mdf_collect(view, i, candidates), kept = 0;
        for (int k = 0; k < n; k++)
            if (!(distance[i] >= 0) ||
                fabsf(candidates[k].mm - distance[i]) > CLOSE * view->agreement_mm)
                candidates[kept++] = candidates[k];
        ret_other[i] = mdf_merge(candidates, kept, 1).mm;
    }
}
