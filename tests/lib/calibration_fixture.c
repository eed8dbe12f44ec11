#include "calibration_fixture.h"
#include "lib/ok.h"

static double boards_theta_deg(const struct fixture_rig *o, int camera) {
    return o->n_cameras == 1 ? o->first_theta_deg
                             : o->first_theta_deg + (o->last_theta_deg - o->first_theta_deg) *
                                                        camera / (o->n_cameras - 1);
}

static char *boards_world_text(const struct fixture *f, const struct fixture_lay *lay) {
    const struct fixture_rig *o = &f->options;
    GString *text = g_string_new(NULL);
    g_string_append_printf(
        text,
        "[world]\nseed = %d\nsupersample = %d\ngather_rays = 0\nwarm_up_s = 0\ncache_mb = 16\n"
        "camera_error_mm = %g\ncamera_error_deg = %g\nbearing_wobble_deg = %g\n"
        "bearing_wobble_per_turn = %d\n\n",
        o->seed, o->supersample, o->error_mm, o->error_deg, o->wobble_deg,
        o->wobble_turns ? o->wobble_turns : 2);
    g_string_append_printf(text,
                           "[sample]\nkind = plate\nwidth_mm = %g\nheight_mm = %g\nbase_mm = %g\n"
                           "top_mm = 200\nalbedo_path = board.png\ntilt_deg = %g\n"
                           "tilt_towards_deg = %g\nturn_deg = %g\noffset_mm = %g;%g\n\n",
                           f->board.columns * f->board.square_mm,
                           f->board.rows * f->board.square_mm, f->board.thickness_mm, lay->tilt_deg,
                           lay->towards_deg, lay->turn_deg, lay->x_mm, lay->y_mm);
    for (int c = 0; c < o->n_cameras; c++) {
        g_string_append_printf(text,
                               "[camera cam%d]\ntheta_deg = %g\nphi_deg = 0\ndistance_mm = %g\n"
                               "width = %d\nheight = %d\nfocal_px = %g\nresponse = 6000\n"
                               "vignetting = 0.06\nread_noise_e = 4\nblur_px = %g\n"
                               "lateral_colour = %g\n",
                               c, boards_theta_deg(o, c), o->distance_mm, o->width, o->height,
                               o->focal_px, o->blur_px, o->lateral_colour);
        /* A lens with typical errors: its focal length and principal point deviate a little from
         * the nominal values, and it has some distortion. */
        GRand *rand = g_rand_new_with_seed((guint32)(o->seed * 100 + c));
        const double scale = 1 + g_rand_double_range(rand, -0.01, 0.01);
        const double x = g_rand_double_range(rand, -0.015, 0.015) * o->width;
        const double y = g_rand_double_range(rand, -0.015, 0.015) * o->width;
        const double k1 = g_rand_double_range(rand, -0.3, 0.1),
                     k2 = g_rand_double_range(rand, 0, 0.2);
        const double p1 = g_rand_double_range(rand, -0.002, 0.002);
        const double p2 = g_rand_double_range(rand, -0.002, 0.002);
        g_string_append_printf(text,
                               "focal_scale = %.6f\ncentre_px = %.4f;%.4f\nk1 = %.5f\nk2 = %.5f\n"
                               "p1 = %.6f\np2 = %.6f\n",
                               scale, x, y, k1, k2, p1, p2);
        g_rand_free(rand);
    }
    g_string_append(text, "\n[lamp lamp0]\ntheta_deg = 20\ndistance_mm = 500\nintensity = 40\n"
                          "exponent = 2\n");
    return g_string_free(text, FALSE);
}

double boards_true_deg(const struct fixture *f, double deg) {
    const double turn = FIXTURE_RAD(deg), seed = f->options.seed;
    return deg + f->options.turntable_error_deg *
                     (0.7 * sin(turn + seed) + 0.3 * sin(37 * turn + 2 * seed));
}

void boards_open(struct fixture *f, const struct fixture_rig *options,
                 const struct fixture_lay *lays, int n_lays) {
    g_autoptr(GError) error = NULL;
    *f = (struct fixture){.options = *options, .n_lays = n_lays};
    g_assert_true(board_parse(&f->board, options->board, &error));
    f->folder = g_dir_make_tmp("mesorig-boards-XXXXXX", NULL);
    const struct fixture_rig *o = &f->options;
    struct rig *rig = &f->nominal;
    *rig = (struct rig){.id = "fixture", .n_cameras = o->n_cameras, .arc_radius_mm = 500};
    for (int c = 0; c < o->n_cameras; c++) {
        struct rig_camera *camera = &rig->cameras[c];
        g_snprintf(camera->name, RIG_NAME, "cam%d", c);
        camera->width = o->width;
        camera->height = o->height;
        camera->fx_px = camera->fy_px = o->focal_px;
        camera->cx_px = (o->width - 1) / 2.0;
        camera->cy_px = (o->height - 1) / 2.0;
        camera->response = 6000;
        rig_camera_look_at(
            camera,
            vec3_scale(rig_direction(FIXTURE_RAD(boards_theta_deg(o, c)), 0), o->distance_mm),
            vec3(0, 0, 0));
    }
    g_autofree char *print = g_build_filename(f->folder, "board.png", NULL);
    const double cell = f->board.marker_mm > 0 ? f->board.marker_mm / 6 : f->board.square_mm;
    /* so that the cells of a marker are whole pixels */
    const struct board_drawing drawing = {0, 1 / cell};
    ok(board_draw(&f->board, print, &drawing, ERR));
    for (int l = 0; l < n_lays; l++) {
        g_autofree char *name = g_strdup_printf("world%d.conf", l);
        g_autofree char *path = g_build_filename(f->folder, name, NULL);
        g_autofree char *text = boards_world_text(f, &lays[l]);
        g_assert_true(g_file_set_contents(path, text, -1, NULL));
        f->worlds[l] = ok(world_get(path, ERR));
    }
}

void boards_capture(struct fixture *f, int n_stops) {
    const int n_cameras = f->options.n_cameras;
    f->n_stops = n_stops;
    f->n_pictures = f->n_lays * n_stops * n_cameras;
    f->pictures = g_new0(struct cameras_picture, f->n_pictures);
    f->taken = g_new0(struct picture *, f->n_pictures);
    for (int i = 0; i < f->n_pictures; i++) {
        const int camera = i % n_cameras, stop = i / n_cameras % n_stops,
                  lay = i / n_cameras / n_stops;
        const double deg = 360.0 * stop / n_stops;
        g_autofree char *name = g_strdup_printf("lay%d/cam%d at %.1f°", lay, camera, deg);
        f->pictures[i] = (struct cameras_picture){camera, lay, deg};
        /* The exposure at which a white surface reaches four fifths of full scale. */
        struct world_sensor sensor;
        struct world_state state;
        world_sensor(f->worlds[lay], camera, &sensor);
        world_set_turntable(f->worlds[lay], boards_true_deg(f, deg));
        world_set_arc(f->worlds[lay], 90);
        world_set_lamp(f->worlds[lay], 0, TRUE, 0);
        world_snapshot(f->worlds[lay], (gint64)1e7, 20000, &state);
        const gsize n = (gsize)sensor.width * (gsize)sensor.height;
        g_autofree guint16 *pixels = g_new(guint16, n);
        struct picture *picture = picture_new(name, name, sensor.width, sensor.height);
        world_expose(f->worlds[lay], camera, &state, 10000, 0,
                     (guint64)(i + 1000 * f->options.seed), pixels);
        for (gsize k = 0; k < n; k++)
            picture->values[k] = (float)(pixels[k] - sensor.black_level);
        picture_balance(picture, cfa_name(sensor.cfa));
        f->taken[i] = picture;
    }
}

void boards_close(struct fixture *f) {
    g_autoptr(GDir) dir = g_dir_open(f->folder, 0, NULL);
    const char *name;
    for (int l = 0; l < f->n_lays; l++)
        world_unref(f->worlds[l]);
    for (int i = 0; i < f->n_pictures; i++)
        picture_free(f->taken[i]);
    while (dir && (name = g_dir_read_name(dir))) {
        g_autofree char *path = g_build_filename(f->folder, name, NULL);
        g_unlink(path);
    }
    g_rmdir(f->folder);
    g_free(f->folder);
    g_free(f->pictures);
    g_free(f->taken);
}

struct picture *boards_copy(const struct picture *from) {
    struct picture *to = picture_new(from->name, from->checksum, from->width, from->height);
    memcpy(to->values, from->values, sizeof(float) * (gsize)from->width * (gsize)from->height);
    memcpy(to->cfa, from->cfa, sizeof to->cfa);
    return to;
}

struct picture *boards_read(int i, gpointer data, GError **error) {
    const struct fixture *f = data;
    return boards_copy(f->taken[i]);
}

void boards_true_camera(const struct fixture *f, int camera, struct rig_camera *ret) {
    struct truth_camera t;
    truth_camera(f->worlds[0], camera, &t);
    *ret = f->nominal.cameras[camera];
    for (int k = 0; k < 3; k++) {
        ret->rotation.m[0][k] = t.right[k];
        ret->rotation.m[1][k] = t.down[k];
        ret->rotation.m[2][k] = t.forward[k];
    }
    const struct vec3 at = vec3(t.centre_mm[0], t.centre_mm[1], t.centre_mm[2]);
    ret->translation_mm = vec3_scale(mat3_mul_vec(&ret->rotation, at), -1);
    ret->fx_px = ret->fy_px = t.focal_px;
    ret->cx_px = t.centre_px[0];
    ret->cy_px = t.centre_px[1];
    ret->k1 = t.k1;
    ret->k2 = t.k2;
    ret->p1 = t.p1;
    ret->p2 = t.p2;
}

double boards_azimuth_rad(const struct fixture *f, const struct rig *rig) {
    double sum = 0;
    int n = 0;
    for (int c = 0; c < rig->n_cameras; c++) {
        struct rig_camera truth;
        boards_true_camera(f, c, &truth);
        const struct vec3 a = rig_camera_centre_mm(&truth),
                          b = rig_camera_centre_mm(&rig->cameras[c]);
        if (hypot(a.x, a.y) < 20)
            continue;
        sum += remainder(atan2(a.y, a.x) - atan2(b.y, b.x), 2 * G_PI);
        n++;
    }
    return n ? sum / n : 0;
}

static void boards_truth_px(const struct fixture *f, int camera, double azimuth_rad, struct vec3 at,
                            double ret[2]) {
    const struct vec3 turned = rig_turn(at, azimuth_rad);
    truth_project(f->worlds[0], camera, (const double[3]){turned.x, turned.y, turned.z}, ret);
}

/* Solves a 3 × 3 system by Cramer's rule. */
static struct vec3 boards_solve(double h[3][3], const double g[3]) {
    const struct vec3 a = vec3(h[0][0], h[1][0], h[2][0]), b = vec3(h[0][1], h[1][1], h[2][1]),
                      c = vec3(h[0][2], h[1][2], h[2][2]), r = vec3(g[0], g[1], g[2]);
    const double det = vec3_dot(a, vec3_cross(b, c));
    return vec3(vec3_dot(r, vec3_cross(b, c)) / det, vec3_dot(a, vec3_cross(r, c)) / det,
                vec3_dot(a, vec3_cross(b, r)) / det);
}

/* Returns the true position of the point that the calibrated cameras would show at the pixels of
 * `at`. */
static struct vec3 boards_where(const struct fixture *f, const struct rig *rig, double azimuth_rad,
                                struct vec3 at) {
    struct vec3 p = at;
    for (int i = 0; i < 5; i++) {
        double h[3][3] = {{0}}, g[3] = {0};
        for (int c = 0; c < rig->n_cameras; c++) {
            double wanted[2], here[2], d[3][2];
            g_assert_true(rig_project(&rig->cameras[c], at, &wanted[0], &wanted[1]));
            boards_truth_px(f, c, azimuth_rad, p, here);
            boards_truth_px(f, c, azimuth_rad, vec3_add(p, vec3(0.01, 0, 0)), d[0]);
            boards_truth_px(f, c, azimuth_rad, vec3_add(p, vec3(0, 0.01, 0)), d[1]);
            boards_truth_px(f, c, azimuth_rad, vec3_add(p, vec3(0, 0, 0.01)), d[2]);
            for (int k = 0; k < 2; k++)
                for (int a = 0; a < 3; a++) {
                    g[a] += (d[a][k] - here[k]) / 0.01 * (wanted[k] - here[k]);
                    for (int b = 0; b < 3; b++)
                        h[a][b] += (d[a][k] - here[k]) * (d[b][k] - here[k]) / 1e-4;
                }
        }
        p = vec3_add(p, boards_solve(h, g));
    }
    return p;
}

static double boards_point_rms(const struct fixture *f, const struct rig *rig, double azimuth_rad) {
    double sum = 0;
    int n = 0;
    for (int c = 0; c < rig->n_cameras; c++)
        for (int x = -2; x <= 2; x++)
            for (int y = -2; y <= 2; y++)
                for (int z = 0; z <= 2; z++) {
                    const struct vec3 at = vec3(x * 12.5, y * 12.5, z * 5);
                    double seen[2], found[2];
                    boards_truth_px(f, c, azimuth_rad, at, seen);
                    g_assert_true(rig_project(&rig->cameras[c], at, &found[0], &found[1]));
                    sum += pow(seen[0] - found[0], 2) + pow(seen[1] - found[1], 2);
                    n++;
                }
    return sqrt(sum / n);
}

/* Returns the squared Mahalanobis distance dᵀ C⁻¹ d, by Gaussian elimination. */
static double boards_mahalanobis(int n, const double *covariance, const double *d) {
    g_autofree double *a = g_new(double, n *(n + 1));
    double sum = 0;
    for (int i = 0; i < n; i++) {
        const double scale = 1 / sqrt(covariance[i * n + i]);
        for (int j = 0; j < n; j++)
            a[i * (n + 1) + j] = covariance[i * n + j] * scale / sqrt(covariance[j * n + j]);
        a[i * (n + 1) + n] = d[i] * scale;
    }
    for (int i = 0; i < n; i++) { /* LDLᵀ: each pivot adds one term to the sum */
        const double pivot = a[i * (n + 1) + i];
        sum += a[i * (n + 1) + n] * a[i * (n + 1) + n] / pivot;
        for (int r = i + 1; r < n; r++) {
            const double factor = a[r * (n + 1) + i] / pivot;
            for (int j = i; j <= n; j++)
                a[r * (n + 1) + j] -= factor * a[i * (n + 1) + j];
        }
    }
    return sum;
}

double boards_chi2(const struct fixture *f, const struct calibration *calibration, int camera,
                   double azimuth_rad) {
    enum { N = 10 };
    static const int rows[N] = {CALIBRATION_FX,     CALIBRATION_FY,      CALIBRATION_CX,
                                CALIBRATION_CY,     CALIBRATION_TURN_X,  CALIBRATION_TURN_Y,
                                CALIBRATION_TURN_Z, CALIBRATION_SHIFT_X, CALIBRATION_SHIFT_Y,
                                CALIBRATION_SHIFT_Z};
    const struct rig_camera *found = &calibration->rig.cameras[camera];
    struct rig_camera truth;
    double r[3][3], c[N * N];
    boards_true_camera(f, camera, &truth);
    for (int i = 0; i < 3; i++) { /* R_foundᵀ R_true Rz(azimuth) */
        const struct vec3 e = vec3(i == 0, i == 1, i == 2);
        const struct vec3 v = mat3_mul_transposed(
            &found->rotation, mat3_mul_vec(&truth.rotation, rig_turn(e, azimuth_rad)));
        r[0][i] = v.x;
        r[1][i] = v.y;
        r[2][i] = v.z;
    }
    const double d[N] = {truth.fx_px - found->fx_px,
                         truth.fy_px - found->fy_px,
                         truth.cx_px - found->cx_px,
                         truth.cy_px - found->cy_px,
                         (r[2][1] - r[1][2]) / 2,
                         (r[0][2] - r[2][0]) / 2,
                         (r[1][0] - r[0][1]) / 2,
                         truth.translation_mm.x - found->translation_mm.x,
                         truth.translation_mm.y - found->translation_mm.y,
                         truth.translation_mm.z - found->translation_mm.z};
    for (int i = 0; i < N; i++)
        for (int j = 0; j < N; j++)
            c[i * N + j] = calibration->cameras[camera].covariance[rows[i]][rows[j]];
    return boards_mahalanobis(N, c, d) / N;
}

struct fixture_errors boards_compare(const struct fixture *f,
                                     const struct calibration *calibration) {
    const struct rig *rig = &calibration->rig;
    const double azimuth = boards_azimuth_rad(f, rig);
    struct fixture_errors errors = {.point_px = boards_point_rms(f, rig, azimuth)};
    for (int c = 0; c < rig->n_cameras; c++) {
        struct rig_camera truth;
        boards_true_camera(f, c, &truth);
        const struct vec3 a = rig_turn(rig_camera_centre_mm(&truth), -azimuth),
                          b = rig_camera_centre_mm(&rig->cameras[c]);
        const double apart = vec3_length(vec3_cross(a, b)) / vec3_length(a) / vec3_length(b);
        errors.direction_deg = MAX(errors.direction_deg, FIXTURE_DEG(asin(apart)));
        errors.distance_pct =
            MAX(errors.distance_pct, 100 * fabs(vec3_length(b) / vec3_length(a) - 1));
        errors.chi2 += boards_chi2(f, calibration, c, azimuth) / rig->n_cameras;
    }
    const struct vec3 low = boards_where(f, rig, azimuth, vec3(0, 0, -20)),
                      high = boards_where(f, rig, azimuth, vec3(0, 0, 30));
    const struct vec3 middle = vec3_scale(vec3_add(low, high), 0.5);
    errors.axis_mm = hypot(middle.x, middle.y);
    errors.axis_deg = FIXTURE_DEG(atan2(hypot(high.x - low.x, high.y - low.y), high.z - low.z));
    return errors;
}

/* The frames of truth and calibration differ by the zero of the azimuth. The angles are the true
 * ones of the turntable, so that the errors of the turntable have no effect. */
double boards_turned_px(const struct fixture *f, const struct calibration *calibration) {
    const double azimuth = boards_azimuth_rad(f, &calibration->rig);
    double sum = 0;
    int n = 0;
    for (int deg = 7; deg < 360; deg += 23)
        for (int c = 0; c < f->options.n_cameras; c++)
            for (int k = 0; k < 4; k++) {
                const double at[3] = {k & 1 ? 25 : -25, k & 2 ? 25 : -25, 3};
                double rig_mm[3], truth[2], x, y;
                truth_to_rig(f->worlds[0], deg, at, rig_mm);
                truth_project(f->worlds[0], c, rig_mm, truth);
                const struct vec3 p = rig_turn(vec3(at[0], at[1], at[2]), -azimuth);
                g_assert_true(rig_project(&calibration->rig.cameras[c],
                                          rig_sample_point(&calibration->rig, FIXTURE_RAD(deg), p),
                                          &x, &y));
                sum += pow(x - truth[0], 2) + pow(y - truth[1], 2);
                n++;
            }
    return sqrt(sum / n);
}
