/* The limit of processing is to read and decode each file of the session and to rectify one plane
 * of it, once, with weights that are already known. A lamp's picture is rectified with a guide. Of
 * a sweep, the plane of peaks is rectified as a grey picture.
 *
 * In sessions made here, all pictures of a camera are one file with many names. Each sweep is a
 * file of its own: the peak of a pixel follows from the point of a wavy surface that the pixel
 * sees. */
#include "speed_parts.h"

#include "bench.h"
#include "calibration/calibration.h"
#include "exr/exr.h"
#include "frames/rectify.h"
#include "lib/process.h"
#include "lib/remove_tree.h"
#include "measurement_rig.h"
#include "pipeline/catalogue.h"
#include "pipeline/pipeline.h"

#include <glib/gstdio.h>
#include <math.h>
#include <stdio.h>
#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#define RAD(deg)      ((deg) * (G_PI / 180))
#define SAMPLE_MM     50.0
#define VIEWS         2
#define LIGHTS        24 /* and POSITIONS: in the ratio of the demo */
#define POSITIONS     10
#define STEPS         96
#define MARGIN_MM     2.0
#define RADIUS_MM     60.0        /* of the flat face around the sample */
#define SMALL_PIXELS  (256 * 256) /* up to this size, capture does not compress pictures */
#define WAVE_MM       6.25
#define PEAK_FRAMES   0.03 /* noise of a peak's time */
#define SECOND_PULSES 0.02 /* share of the pixels with a second pulse */

static const int view_camera[VIEWS] = {1, 3}; /* at 30 and 60° */

static void calibrate(struct calibration *calibration) {
    struct rig *rig = &calibration->rig;
    for (int i = 0; i < rig->n_cameras; i++) {
        calibration->camera_radiometry[i] =
            (struct radiometry_camera){.known = TRUE, .colour = {1, 1, 1}, .glare_error = 1e-4};
        calibration->noise[i] = (struct calibration_noise){
            .known = TRUE,
            .transfer = {.black_dn = 64, .gain_dn_e = 0.25, .read_noise_e = 4, .n_points = 9}};
        calibration->cameras[i].known = TRUE;
        calibration->cameras[i].residual_rms_px = 0.05;
    }
    for (int i = 0; i < rig->n_lasers; i++) {
        struct calibration_laser *laser = &calibration->lasers[i];
        laser->known = TRUE;
        laser->line_rad = 1e-3;
        rig->lasers[i].bend_rad = 2e-4;
        for (int k = 0; k < RIG_SHEET_PARAMETERS; k++)
            laser->sheet.covariance[k][k] = k == RIG_SHEET_OFFSET ? 4e-4 : 1e-8;
    }
}

static struct calibration *new_calibration(const struct bench_setup *setup) {
    struct rig *rig = g_new0(struct rig, 1);
    bench_rig(setup, rig);
    struct calibration *calibration = calibration_new(rig);
    calibrate(calibration);
    g_free(rig);
    return calibration;
}

/* Sets the sweep angles between which the laser crosses the sample's box and a margin. */
static void set_range(const struct rig *rig, const struct session_grid *grid,
                      struct session_shot *shot) {
    shot->sweep_from_deg = G_MAXDOUBLE;
    shot->sweep_to_deg = -G_MAXDOUBLE;
    shot->sweep_steps = STEPS;
    for (int corner = 0; corner < 8; corner++) {
        const double x = grid->width_mm / 2 + MARGIN_MM, y = grid->height_mm / 2 + MARGIN_MM;
        const double z = grid->reference_mm - (corner & 4 ? grid->depth_mm : 0);
        const struct vec3 p =
            rig_turn(vec3(corner & 1 ? x : -x, corner & 2 ? y : -y, z), RAD(shot->turntable_deg));
        const double deg =
            rig_laser_sweep_rad(&rig->arc, &rig->lasers[shot->device], RAD(shot->arc_deg), p) *
            180 / G_PI;
        shot->sweep_from_deg = MIN(shot->sweep_from_deg, deg);
        shot->sweep_to_deg = MAX(shot->sweep_to_deg, deg);
    }
}

struct directions {
    struct session_direction views[VIEWS], lights[LIGHTS], lasers[POSITIONS];
    struct session_shot shots[VIEWS * (LIGHTS + POSITIONS)];
};

static void make_plan(const struct rig *rig, struct directions *of, struct session_plan *plan) {
    for (int v = 0; v < VIEWS; v++)
        of->views[v] = (struct session_direction){.index = v,
                                                  .device = view_camera[v],
                                                  .theta_deg = bench_elevation_deg(view_camera[v]),
                                                  .phi_deg = -20.0 * v,
                                                  .turntable_deg = 20.0 * v};
    for (int l = 0; l < LIGHTS; l++)
        of->lights[l] = (struct session_direction){.index = l,
                                                   .device = l % rig->n_lamps,
                                                   .theta_deg = bench_elevation_deg(l % RIG_VIEWS),
                                                   .phi_deg = 15.0 * l};
    for (int l = 0; l < POSITIONS; l++)
        of->lasers[l] = (struct session_direction){.index = l,
                                                   .device = l % rig->n_lasers,
                                                   .theta_deg = bench_elevation_deg(l % RIG_VIEWS),
                                                   .phi_deg = 37.0 * l + 15};
    *plan = (struct session_plan){.grid = plan->grid,
                                  .views = of->views,
                                  .lights = of->lights,
                                  .lasers = of->lasers,
                                  .n_views = VIEWS,
                                  .n_lights = LIGHTS,
                                  .n_lasers = POSITIONS,
                                  .shots = of->shots,
                                  .n_shots = VIEWS * (LIGHTS + POSITIONS)};
    for (int i = 0; i < plan->n_shots; i++) {
        const int view = i / (LIGHTS + POSITIONS), k = i % (LIGHTS + POSITIONS);
        const gboolean lamp = k < LIGHTS;
        const struct session_direction *source = lamp ? &of->lights[k] : &of->lasers[k - LIGHTS];
        of->shots[i] = (struct session_shot){.id = i + 1,
                                             .kind = lamp ? SHOT_LAMP : SHOT_SWEEP,
                                             .pose = i,
                                             .turntable_deg = of->views[view].turntable_deg,
                                             .arc_deg = source->phi_deg,
                                             .source = source->index,
                                             .device = source->device,
                                             .cameras = camera_set_of(view_camera[view])};
        if (!lamp)
            set_range(rig, &plan->grid, &of->shots[i]);
    }
}

static void write_part(const char *path, struct exr_part *part, gboolean compress) {
    struct exr_file *file = exr_file_new();
    exr_file_add(file, part);
    g_autoptr(GError) error = NULL;
    exr_write(path, file, compress ? EXR_PIZ : EXR_NONE, FALSE, &error);
    bench_check(error);
    exr_file_free(file);
}

static gboolean is_compressed(const struct rig_camera *camera) {
    return camera->width * camera->height > SMALL_PIXELS;
}

/* A picture with waves and noise. */
static void write_picture(const char *path, const struct rig_camera *camera) {
    static const char *const channels[] = {"Y", NULL};
    struct exr_part *part =
        exr_part_new("radiance", camera->width, camera->height, channels, EXR_HALF);
    GRand *rand = g_rand_new_with_seed(1);
    for (int i = 0; i < camera->width * camera->height; i++) {
        const int column = i % camera->width, row = i / camera->width;
        part->planes[0][i] =
            (float)(60 + 40 * sin(column * 0.7) * cos(row * 0.5) + g_rand_double(rand) * 2);
    }
    g_rand_free(rand);
    exr_set_string(part, "mesorig.cfa", "rggb");
    exr_set_string(part, "mesorig.exposures_us", "4000;16000");
    write_part(path, part, is_compressed(camera));
}

/* Returns the point that a pixel sees: of a wavy surface below the reference plane, or of the face
 * around the sample. */
static struct vec3 point_of(const struct session_grid *grid, struct vec3 eye, struct vec3 ray,
                            struct rig_rotation back) {
    double z = grid->reference_mm;
    struct vec3 p = {0, 0, 0};
    for (int round = 0; round < 4; round++) {
        p = vec3_add(eye, vec3_scale(ray, (z - eye.z) / ray.z));
        const struct vec3 q = rig_rotate(back, p);
        if (fabs(q.x) > grid->width_mm / 2 + MARGIN_MM ||
            fabs(q.y) > grid->height_mm / 2 + MARGIN_MM)
            return vec3_add(eye, vec3_scale(ray, -eye.z / ray.z));
        z = grid->reference_mm - 1 +
            0.6 * sin(2 * G_PI * q.x / WAVE_MM) * cos(2 * G_PI * q.y / WAVE_MM);
    }
    return p;
}

static void write_sweep(const char *path, const struct rig *rig, int camera_index,
                        const struct session_grid *grid, const struct session_shot *shot) {
    static const char *const channels[] = {"intensity",   "peak",  "second_intensity",
                                           "second_peak", "width", NULL};
    const struct rig_camera *camera = &rig->cameras[camera_index];
    const struct vec3 eye = rig_camera_centre_mm(camera);
    const struct rig_rotation back = rig_rotation(-RAD(shot->turntable_deg));
    struct exr_part *part =
        exr_part_new("sweep", camera->width, camera->height, channels, EXR_FLOAT);
    GRand *rand = g_rand_new_with_seed((guint32)shot->id);
    for (int i = 0; i < camera->width * camera->height; i++) {
        const int column = i % camera->width, row = i / camera->width;
        const struct vec3 ray = rig_pixel_ray(camera, column, row);
        const struct vec3 p = point_of(grid, eye, ray, back);
        const double deg =
            rig_laser_sweep_rad(&rig->arc, &rig->lasers[shot->device], RAD(shot->arc_deg), p) *
            180 / G_PI;
        const double peak = (deg - shot->sweep_from_deg) /
                                (shot->sweep_to_deg - shot->sweep_from_deg) * (STEPS - 1) +
                            (g_rand_double(rand) - 0.5) * PEAK_FRAMES;
        const gboolean seen = peak >= 0 && peak <= STEPS - 1;
        const gboolean second = seen && g_rand_double(rand) < SECOND_PULSES;
        const float values[] = {seen ? (float)g_rand_double_range(rand, 300, 900) : 0,
                                seen ? (float)peak : -1, second ? 100 : 0,
                                second ? (float)g_rand_double_range(rand, 0, STEPS - 1) : -1,
                                seen ? (float)g_rand_double_range(rand, 0.9, 1.1) : 0};
        for (int c = 0; c < part->n_channels; c++)
            part->planes[c][i] = values[c];
    }
    g_rand_free(rand);
    exr_set_double(part, "sweep.from_deg", shot->sweep_from_deg);
    exr_set_double(part, "sweep.to_deg", shot->sweep_to_deg);
    exr_set_int(part, "sweep.steps", shot->sweep_steps);
    write_part(path, part, is_compressed(camera));
}

static void take_shot(Session *session, const struct rig *rig, const struct session_grid *grid,
                      const struct session_shot *shot, const char *const pictures[VIEWS]) {
    const int view = (int)(shot->id - 1) / (LIGHTS + POSITIONS), camera = view_camera[view];
    g_autofree char *relative = session_frame_path(shot, rig->cameras[camera].name);
    g_autofree char *path = session_file(session, relative);
    g_autoptr(GError) error = NULL;
    gint64 bytes = 0;
    if (shot->kind == SHOT_SWEEP)
        write_sweep(path, rig, camera, grid, shot);
    else if (link(pictures[view], path) != 0)
        bench_fail(1, "%s: cannot be linked", path);
    g_autofree char *sum = exr_sha256(path, &bytes, &error);
    bench_check(error);
    const struct session_frame row = {
        .shot = shot->id, .camera = camera, .path = relative, .sha256 = sum, .bytes = bytes};
    session_commit_shot(session, shot->id, SHOT_DONE, &row, 1, NULL, &error);
    bench_check(error);
}

static void make_session(const char *path, const char *folder, int texels) {
    const struct bench_setup setup = {.material = "weave",
                                      .texels = texels,
                                      .texel_mm = SAMPLE_MM / texels,
                                      .pixels_a_texel = 2,
                                      .keep_focal = TRUE};
    g_autoptr(Calibration) calibration = new_calibration(&setup);
    g_autofree char *text = calibration_to_text(calibration);
    const struct rig *rig = &calibration->rig;
    struct directions *directions = g_new0(struct directions, 1);
    struct session_plan plan = {.grid = bench_grid(&setup)};
    const struct laser_reference reference = {
        .plane_error_mm = 0.02,
        .hole_mm = {SAMPLE_MM + 4 * MARGIN_MM, SAMPLE_MM + 4 * MARGIN_MM},
        .radius_mm = RADIUS_MM};
    g_autofree char *reference_text = laser_reference_to_text(&reference);
    g_autofree char *pictures[VIEWS] = {NULL};
    const struct session_texts texts = {"", "", text, NULL};
    g_autoptr(GError) error = NULL;
    make_plan(rig, directions, &plan);
    for (int v = 0; v < VIEWS; v++) {
        pictures[v] = g_strdup_printf("%s/picture_%d.exr", folder, v);
        write_picture(pictures[v], &rig->cameras[view_camera[v]]);
    }
    g_autoptr(Session) session = session_create(path, "processing", &texts, &plan, &error);
    bench_check(error);
    session_set_value(session, LASER_REFERENCE_KEY, reference_text, &error);
    bench_check(error);
    for (int i = 0; i < plan.n_shots; i++)
        take_shot(session, rig, &plan.grid, &plan.shots[i], (const char *const *)pictures);
    session_set_value(session, "state", "done", &error);
    bench_check(error);
    g_free(directions);
}

static double since_s(gint64 begun_us) {
    return (double)(speed_now_us() - begun_us) / G_USEC_PER_SEC;
}

/* Reads, decodes and rectifies a plane of a file. */
static void take_file(const char *path, const char *channel, Rectify *rectify, gboolean guide,
                      float *rgb, struct speed_processing *ret) {
    g_autoptr(GError) error = NULL;
    const gint64 begun_us = speed_now_us();
    g_autoptr(ExrFile) file = exr_read(path, &error);
    bench_check(error);
    ret->decode_s += since_s(begun_us);
    const struct exr_part *part = g_ptr_array_index(file->parts, 0);
    const float *plane = exr_part_plane(part, channel);
    if (guide)
        rectify_guide(rectify, plane);
    const gint64 decoded_us = speed_now_us();
    rectify_apply(rectify, plane, rgb, NULL);
    ret->rectify_s += since_s(decoded_us);
    ret->megapixels += part->width * part->height / 1e6;
    ret->files++;
}

static void take_view(const struct catalogue *catalogue, int view, float *rgb,
                      struct speed_processing *ret) {
    struct btf_view *btf = NULL;
    struct mdf_job *mdf = NULL;
    g_autoptr(GError) error = NULL;
    if (catalogue_btf(catalogue, view, &btf) == CATALOGUE_READY) {
        g_autoptr(Rectify) rectify = rectify_new(btf->camera, btf->radiometry, "rggb",
                                                 btf->turntable_rad, &btf->grid, &error);
        bench_check(error);
        for (guint i = 0; i < btf->lights->len; i++)
            take_file(g_array_index(btf->lights, struct btf_light, i).input.path, "Y", rectify,
                      i == 0, rgb, ret);
    }
    if (catalogue_mdf(catalogue, view, &mdf) == CATALOGUE_READY) {
        g_autoptr(Rectify) rectify =
            rectify_new(mdf->camera, NULL, "mono", mdf->turntable_rad, &catalogue->grid, &error);
        bench_check(error);
        for (guint i = 0; i < mdf->sweeps->len; i++)
            take_file(g_array_index(mdf->sweeps, struct mdf_input, i).input.path, "peak", rectify,
                      FALSE, rgb, ret);
    }
    btf_view_free(btf);
    mdf_job_free(mdf);
}

static void take_limit(const char *path, struct speed_processing *ret) {
    g_autoptr(GError) error = NULL;
    g_autoptr(Session) session = session_open(path, SESSION_READ, &error);
    bench_check(error);
    struct catalogue *catalogue = catalogue_load(session, NULL, &error);
    bench_check(error);
    ret->texels = catalogue->grid.width;
    ret->views = (int)catalogue->views->len;
    g_autofree float *rgb = g_new(float, 3 * catalogue->grid.width * catalogue->grid.height);
    for (int view = 0; view < ret->views; view++)
        take_view(catalogue, view, rgb, ret);
    ret->limit_s = ret->decode_s + ret->rectify_s;
    catalogue_free(catalogue);
}

/* Runs `mesorig process` with its default options in a process of its own, of which the kernel
 * tells the CPU time. */
static gboolean take_process(const char *path, struct speed_processing *ret) {
    struct rusage usage;
    int status = 1;
    const pid_t child = fork();
    if (child == 0) {
        g_autoptr(GPtrArray) causes = g_ptr_array_new_with_free_func(g_free);
        const struct pipeline_options options = {.n_eigenmaps = 4, .causes = causes};
        struct pipeline_result result;
        g_autoptr(GError) error = NULL;
        const gboolean ok = pipeline_run(path, &options, &result, &error);
        if (!ok)
            fprintf(stderr, "bench_speed: %s\n", error->message);
        _exit(!ok);
    }
    if (child < 0 || wait4(child, &status, 0, &usage) != child)
        return FALSE;
    ret->process_s = (double)(usage.ru_utime.tv_sec + usage.ru_stime.tv_sec) +
                     1e-6 * (double)(usage.ru_utime.tv_usec + usage.ru_stime.tv_usec);
    ret->peak_mib = (double)usage.ru_maxrss / 1024;
    return status == 0;
}

/* Copies a session without its products. Frames are hard links. */
static void copy_session(const char *from, const char *to) {
    g_autofree char *database = g_build_filename(from, "session.db", NULL);
    g_autofree char *products = g_build_filename(to, "products", NULL);
    const char *const copy[] = {"cp", "-al", from, to, NULL};
    const char *const own[] = {"cp", "--remove-destination", database, to, NULL};
    if (process_run(copy, NULL, NULL) != 0 || process_run(own, NULL, NULL) != 0)
        bench_fail(1, "%s cannot be copied with hard links to %s; use --folder", from, to);
    remove_tree(products);
}

struct speed_processing speed_processing(int texels, const char *session, const char *folder) {
    struct speed_processing ret = {0};
    g_autofree char *own = g_build_filename(folder, "bench-processing-XXXXXX", NULL);
    g_assert_nonnull(g_mkdtemp(own));
    g_autofree char *path = g_build_filename(own, "processing.session", NULL);
    if (session)
        copy_session(session, path);
    else
        make_session(path, own, texels);
    ret.ok = take_process(path, &ret);
    take_limit(path, &ret);
    remove_tree(own);
    return ret;
}
