#include "bundle_private.h"

#include <ceres/crs_matrix.h>
#include <ceres/loss_function.h>
#include <ceres/manifold.h>
#include <ceres/problem.h>
#include <ceres/sized_cost_function.h>
#include <ceres/solver.h>

#include <glog/logging.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <vector>

G_DEFINE_QUARK(bundle_error, bundle_error)

namespace {

/* Ceres must not write to stderr, because failures are reported as errors. */
const bool quiet = [] {
    FLAGS_minloglevel = google::GLOG_FATAL;
    if (!google::IsGoogleLoggingInitialized())
        google::InitGoogleLogging("mesorig");
    return true;
}();

/* standard deviation of the gauge constraints, which are nearly exact */
constexpr double GAUGE_SIGMA_RAD = 1e-7;
/* prior standard deviation of fx / fy from its prior value */
constexpr double ASPECT_SIGMA = 0.002;
/* prior standard deviation of each coefficient of the wobble, rad */
constexpr double WOBBLE_SIGMA = 0.002;

/* Residual of a corner, whitened and divided by the corner's noise. */
struct Reprojection final
    : ceres::SizedCostFunction<2, BUNDLE_INTRINSICS, 6, 6, 1, 3, BUNDLE_WOBBLE> {
    const bundle *b;
    const bundle_observation *o;

    Reprojection(const bundle *of, const bundle_observation *observation) : b(of), o(observation) {
    }

    bool Evaluate(double const *const *parameters, double *residuals,
                  double **jacobians) const override {
        static constexpr int sizes[] = {BUNDLE_INTRINSICS, 6, 6, 1, 3, BUNDLE_WOBBLE};
        const bundle_camera &camera = b->cameras[o->camera];
        const bundle_stop &stop = b->stops[o->stop];
        const bundle_parameters at = {parameters[0],     parameters[1], parameters[2],
                                      parameters[3][0],  parameters[4], parameters[5],
                                      stop.commanded_rad};
        double px[2];
        bundle_slopes slopes;
        if (!bundle_image(&camera, &b->lays[stop.lay], &at, o->board_mm, px,
                          jacobians ? &slopes : nullptr))
            return false;
        const double noise = camera.noise * o->noise;
        const double d[2] = {px[0] - o->seen_px[0], px[1] - o->seen_px[1]};
        const double *const from[] = {slopes.lens[0], slopes.pose[0], slopes.lay[0],
                                      slopes.angle,   slopes.bend[0], slopes.wobble[0]};
        for (int i = 0; i < 2; i++) {
            const double *w = o->whiten[i];
            residuals[i] = (w[0] * d[0] + w[1] * d[1]) / noise;
            for (int k = 0; jacobians && k < 6; k++)
                for (int l = 0; jacobians[k] && l < sizes[k]; l++)
                    jacobians[k][i * sizes[k] + l] =
                        (w[0] * from[k][l] + w[1] * from[k][sizes[k] + l]) / noise;
        }
        return true;
    }
};

struct LensPrior final : ceres::SizedCostFunction<BUNDLE_INTRINSICS + 1, BUNDLE_INTRINSICS> {
    const bundle_camera *camera;

    explicit LensPrior(const bundle_camera *of) : camera(of) {
    }

    bool Evaluate(double const *const *parameters, double *residuals,
                  double **jacobians) const override {
        const int n = BUNDLE_INTRINSICS;
        const double *lens = parameters[0], *prior = camera->prior;
        double *j = jacobians ? jacobians[0] : nullptr;
        if (j)
            std::fill(j, j + (n + 1) * n, 0.0);
        for (int i = 0; i < n; i++) {
            const double weight = camera->prior_sigma[i] > 0 ? 1 / camera->prior_sigma[i] : 0;
            residuals[i] = (lens[i] - prior[i]) * weight;
            if (j)
                j[i * n + i] = weight;
        }
        residuals[n] = (lens[0] / lens[1] - prior[0] / prior[1]) / ASPECT_SIGMA;
        if (j) {
            j[n * n] = 1 / lens[1] / ASPECT_SIGMA;
            j[n * n + 1] = -lens[0] / (lens[1] * lens[1]) / ASPECT_SIGMA;
        }
        return true;
    }
};

struct WobblePrior final : ceres::SizedCostFunction<BUNDLE_WOBBLE, BUNDLE_WOBBLE> {
    bool Evaluate(double const *const *parameters, double *residuals,
                  double **jacobians) const override {
        for (int i = 0; i < BUNDLE_WOBBLE; i++) {
            residuals[i] = parameters[0][i] / WOBBLE_SIGMA;
            for (int k = 0; jacobians && jacobians[0] && k < BUNDLE_WOBBLE; k++)
                jacobians[0][BUNDLE_WOBBLE * i + k] = i == k ? 1 / WOBBLE_SIGMA : 0;
        }
        return true;
    }
};

struct BendPrior final : ceres::SizedCostFunction<3, 3> {
    double sigma;

    explicit BendPrior(double standard_deviation) : sigma(standard_deviation) {
    }

    bool Evaluate(double const *const *parameters, double *residuals,
                  double **jacobians) const override {
        for (int i = 0; i < 3; i++) {
            residuals[i] = parameters[0][i] / sigma;
            for (int k = 0; jacobians && jacobians[0] && k < 3; k++)
                jacobians[0][3 * i + k] = i == k ? 1 / sigma : 0;
        }
        return true;
    }
};

struct AnglePrior final : ceres::SizedCostFunction<1, 1> {
    double commanded, sigma;

    AnglePrior(double mean, double standard_deviation)
        : commanded(mean), sigma(standard_deviation) {
    }

    bool Evaluate(double const *const *parameters, double *residuals,
                  double **jacobians) const override {
        residuals[0] = (parameters[0][0] - commanded) / sigma;
        if (jacobians && jacobians[0])
            jacobians[0][0] = 1 / sigma;
        return true;
    }
};

/* This gauge constraint makes the mean deviation of a lay's angles from the commanded angles 0. */
struct MeanAngle final : ceres::CostFunction {
    std::vector<double> commanded;

    explicit MeanAngle(const std::vector<double> &angles) : commanded(angles) {
        set_num_residuals(1);
        mutable_parameter_block_sizes()->assign(angles.size(), 1);
    }

    bool Evaluate(double const *const *angles, double *residuals,
                  double **jacobians) const override {
        const double weight = 1 / ((double)commanded.size() * GAUGE_SIGMA_RAD);
        residuals[0] = 0;
        for (gsize i = 0; i < commanded.size(); i++) {
            residuals[0] += (angles[i][0] - commanded[i]) * weight;
            if (jacobians && jacobians[i])
                jacobians[i][0] = weight;
        }
        return true;
    }
};

/* This gauge constraint makes the mean azimuth of the cameras' centres, relative to the nominal
 * centres, 0. With the adjusted centres c and the nominal centres n, both in the xy plane, Σ (c ×
 * n)_z / |n|² = 0. A camera with a fixed pose counts as well. It stays at its nominal centre, so
 * that its part is 0. Cameras near the zenith are left out (add_cameras()). */
struct MeanAzimuth final : ceres::CostFunction {
    std::vector<const bundle_camera *> cameras;

    explicit MeanAzimuth(const std::vector<const bundle_camera *> &of) : cameras(of) {
        set_num_residuals(1);
        mutable_parameter_block_sizes()->assign(of.size(), 6);
    }

    bool Evaluate(double const *const *poses, double *residuals,
                  double **jacobians) const override {
        residuals[0] = 0;
        for (gsize k = 0; k < cameras.size(); k++) {
            double c[3], slopes[3][6];
            bundle_centre(cameras[k], poses[k], c, slopes);
            const double *n = cameras[k]->nominal_centre;
            const double weight =
                1 / ((n[0] * n[0] + n[1] * n[1]) * (double)cameras.size() * GAUGE_SIGMA_RAD);
            residuals[0] += (c[0] * n[1] - c[1] * n[0]) * weight;
            for (int i = 0; jacobians && jacobians[k] && i < 6; i++)
                jacobians[k][i] = (slopes[0][i] * n[1] - slopes[1][i] * n[0]) * weight;
        }
        return true;
    }
};

/* The parameter blocks and the problem in the form that Ceres needs. */
struct Work {
    bundle *b;
    /* cameras that share a lens use the element lens_of() */
    std::vector<std::array<double, BUNDLE_INTRINSICS>> lenses;
    std::vector<std::array<double, 6>> poses, lays;
    std::vector<double> angles;
    std::array<double, 3> bend;
    std::array<double, BUNDLE_WOBBLE> wobble;
    /* number of observations of each lay, stop, camera and lens */
    std::vector<int> of_lay, of_stop, of_camera, of_lens;
    ceres::Problem problem;

    explicit Work(bundle *from)
        : b(from), lenses((gsize)b->n_cameras), poses(lenses.size()), lays((gsize)b->n_lays),
          angles((gsize)b->n_stops), of_lay(lays.size()), of_stop(angles.size()),
          of_camera(lenses.size()), of_lens(lenses.size()) {
        for (gsize i = 0; i < lenses.size(); i++) {
            const bundle_camera &c = b->cameras[i];
            std::memcpy(lenses[i].data(), c.intrinsics, sizeof c.intrinsics);
            poses[i] = {0, 0, 0, c.shift[0], c.shift[1], c.shift[2]};
        }
        for (gsize i = 0; i < lays.size(); i++)
            lays[i] = {0, 0, 0, b->lays[i].place[0], b->lays[i].place[1], b->lays[i].place[2]};
        for (gsize i = 0; i < angles.size(); i++)
            angles[i] = b->stops[i].angle_rad;
        std::memcpy(bend.data(), b->bend, sizeof b->bend);
        std::memcpy(wobble.data(), b->wobble, sizeof b->wobble);
        add_observations();
        if (problem.HasParameterBlock(bend.data()) && b->bend_sigma > 0)
            problem.AddResidualBlock(new BendPrior(b->bend_sigma), nullptr, bend.data());
        else if (problem.HasParameterBlock(bend.data()))
            problem.SetParameterBlockConstant(bend.data());
        if (problem.HasParameterBlock(wobble.data()))
            add_wobble();
        add_cameras();
        add_turntable();
    }

    gsize lens_of(gsize camera) const {
        return camera - (gsize)b->cameras[camera].stop;
    }

    void add_observations() {
        for (int i = 0; i < b->n_observations; i++) {
            const bundle_observation &o = b->observations[i];
            if (o.rejected)
                continue;
            const gsize camera = (gsize)o.camera, stop = (gsize)o.stop,
                        lay = (gsize)b->stops[stop].lay;
            of_camera[camera]++;
            of_lens[lens_of(camera)]++;
            of_stop[stop]++;
            of_lay[lay]++;
            problem.AddResidualBlock(new Reprojection(b, &o),
                                     b->robust > 0 ? new ceres::HuberLoss(b->robust) : nullptr,
                                     lenses[lens_of(camera)].data(), poses[camera].data(),
                                     lays[lay].data(), &angles[stop], bend.data(), wobble.data());
        }
    }

    /* Harmonic 1 has two parameters, and every higher harmonic has four. */
    void add_wobble() {
        std::vector<int> unused;
        for (int i = 4 * b->wobble_harmonics - 2; i < BUNDLE_WOBBLE; i++)
            unused.push_back(i);
        if (b->wobble_harmonics < 1) {
            problem.SetParameterBlockConstant(wobble.data());
            return;
        }
        problem.AddResidualBlock(new WobblePrior, nullptr, wobble.data());
        if (!unused.empty())
            problem.SetManifold(wobble.data(), new ceres::SubsetManifold(BUNDLE_WOBBLE, unused));
    }

    void add_lens(const bundle_camera &c, double *lens) {
        std::vector<int> unused;
        problem.AddResidualBlock(new LensPrior(&c), nullptr, lens);
        for (int k = 0; k < BUNDLE_INTRINSICS; k++)
            if (!bundle_has(c.lens, k))
                unused.push_back(k);
        if (c.fixed_lens)
            problem.SetParameterBlockConstant(lens);
        else if (!unused.empty())
            problem.SetManifold(lens, new ceres::SubsetManifold(BUNDLE_INTRINSICS, unused));
    }

    void add_cameras() {
        std::vector<const bundle_camera *> aside;
        std::vector<double *> blocks;
        for (gsize i = 0; i < lenses.size(); i++) {
            const bundle_camera &c = b->cameras[i];
            const double *n = c.nominal_centre;
            if (of_lens[i] > 0)
                add_lens(c, lenses[i].data());
            if (of_camera[i] == 0)
                continue;
            if (c.fixed_pose)
                problem.SetParameterBlockConstant(poses[i].data());
            if (std::hypot(n[0], n[1]) < 0.1 * std::fabs(n[2]))
                continue; /* the azimuth of a camera near the zenith is undetermined */
            aside.push_back(&c);
            blocks.push_back(poses[i].data());
        }
        if (b->fix_azimuth && !blocks.empty())
            problem.AddResidualBlock(new MeanAzimuth(aside), nullptr, blocks);
    }

    void add_turntable() {
        for (gsize l = 0; l < lays.size(); l++) {
            std::vector<double> commanded;
            std::vector<double *> blocks;
            if (of_lay[l] == 0)
                continue;
            if (b->lays[l].fixed)
                problem.SetParameterBlockConstant(lays[l].data());
            else if (b->lays[l].fixed_height)
                problem.SetManifold(lays[l].data(), new ceres::SubsetManifold(6, {5}));
            for (gsize i = 0; i < angles.size(); i++) {
                const bundle_stop &stop = b->stops[i];
                if (stop.lay != (int)l || of_stop[i] == 0 || !(stop.sigma_rad > 0))
                    continue;
                commanded.push_back(stop.commanded_rad);
                blocks.push_back(&angles[i]);
            }
            if (b->fix_azimuth && !blocks.empty())
                problem.AddResidualBlock(new MeanAngle(commanded), nullptr, blocks);
        }
        for (gsize i = 0; i < angles.size(); i++) {
            if (of_stop[i] == 0)
                continue;
            if (b->stops[i].sigma_rad > 0)
                problem.AddResidualBlock(
                    new AnglePrior(b->stops[i].commanded_rad, b->stops[i].sigma_rad), nullptr,
                    &angles[i]);
            else
                problem.SetParameterBlockConstant(&angles[i]);
        }
    }

    /* Copies the parameters back; the rotation vectors ω are multiplied into R₀. */
    void keep() {
        for (gsize i = 0; i < lenses.size(); i++) {
            bundle_camera &c = b->cameras[i];
            std::memcpy(c.intrinsics, lenses[lens_of(i)].data(), sizeof c.intrinsics);
            bundle_turn(c.rotation, poses[i].data());
            std::memcpy(c.shift, &poses[i][3], sizeof c.shift);
        }
        for (gsize i = 0; i < lays.size(); i++) {
            bundle_turn(b->lays[i].rotation, lays[i].data());
            std::memcpy(b->lays[i].place, &lays[i][3], sizeof b->lays[i].place);
        }
        for (gsize i = 0; i < angles.size(); i++)
            b->stops[i].angle_rad = angles[i];
        std::memcpy(b->bend, bend.data(), sizeof b->bend);
        std::memcpy(b->wobble, wobble.data(), sizeof b->wobble);
    }

    /* Returns all free parameter blocks in the order of the Jacobian's columns. lens and pose get
     * the first column of each camera's lens and pose, and ret_wobble that of the wobble. A block
     * that is fixed or unused has −1. */
    std::vector<double *> free_blocks(std::vector<int> *lens, std::vector<int> *pose,
                                      int *ret_wobble) {
        std::vector<double *> blocks;
        int columns = 0;
        const auto add = [&](double *block, bool used) {
            if (!used || problem.IsParameterBlockConstant(block))
                return -1;
            const int first = columns;
            blocks.push_back(block);
            columns += problem.ParameterBlockTangentSize(block);
            return first;
        };
        for (gsize i = 0; i < lenses.size(); i++) {
            lens->push_back(lens_of(i) == i ? add(lenses[i].data(), of_lens[i] > 0)
                                            : (*lens)[lens_of(i)]);
            pose->push_back(add(poses[i].data(), of_camera[i] > 0));
        }
        for (gsize i = 0; i < lays.size(); i++)
            add(lays[i].data(), of_lay[i] > 0);
        for (gsize i = 0; i < angles.size(); i++)
            add(&angles[i], of_stop[i] > 0);
        add(bend.data(), problem.HasParameterBlock(bend.data()));
        *ret_wobble = add(wobble.data(), problem.HasParameterBlock(wobble.data()));
        return blocks;
    }
};

gboolean fail(GError **error, int code, const char *why) {
    g_set_error(error, BUNDLE_ERROR, code,
                "the joint refinement of cameras and boards has failed: %s", why);
    return FALSE;
}

} // namespace

gboolean bundle_solve(struct bundle *bundle, GError **error) {
    try {
        Work work(bundle);
        ceres::Solver::Options options;
        ceres::Solver::Summary summary;
        options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
        options.sparse_linear_algebra_library_type = ceres::EIGEN_SPARSE;
        options.max_num_iterations = bundle->coarse ? 30 : 100;
        options.function_tolerance = bundle->coarse ? 1e-5 : 1e-12;
        options.parameter_tolerance = 1e-12;
        options.max_num_consecutive_invalid_steps = 30;
        options.num_threads = 1;
        options.logging_type = ceres::SILENT;
        ceres::Solve(options, &work.problem, &summary);
        if (!summary.IsSolutionUsable())
            return fail(error, BUNDLE_ERROR_FAILED,
                        (summary.message +
                         " (Ceres); check --board, and on a rig the cameras of its rig file")
                            .c_str());
        work.keep();
        return TRUE;
    } catch (const std::exception &e) {
        return fail(error, BUNDLE_ERROR_FAILED, e.what());
    }
}

gboolean bundle_covariance(struct bundle *bundle, double *ret_inflation, GError **error) {
    try {
        Work work(bundle);
        ceres::Problem::EvaluateOptions options;
        ceres::CRSMatrix j;
        std::vector<int> lens, pose;
        std::vector<double> residuals;
        int wobble = -1;
        options.parameter_blocks = work.free_blocks(&lens, &pose, &wobble);
        if (!work.problem.Evaluate(options, nullptr, &residuals, nullptr, &j))
            return fail(error, BUNDLE_ERROR_FAILED,
                        "the fit has put a board behind the camera that sees it; check --board, "
                        "and on a rig the cameras of its rig file");
        const bundle_linear linear = {
            j.num_rows,      j.num_cols,
            j.rows.data(),   j.cols.data(),
            j.values.data(), residuals.data(),
            lens.data(),     pose.data(),
            wobble,          wobble < 0 ? 0 : 4 * bundle->wobble_harmonics - 2};
        return bundle_scatter(bundle, &linear, ret_inflation, error);
    } catch (const std::exception &e) {
        return fail(error, BUNDLE_ERROR_FAILED, e.what());
    }
}

gboolean bundle_project(const struct bundle *bundle, int camera, int stop, gboolean straight,
                        const double board_mm[2], double ret_px[2]) {
    bundle_camera c = bundle->cameras[camera];
    const bundle_stop &s = bundle->stops[stop];
    const bundle_lay &l = bundle->lays[s.lay];
    const double lay[6] = {0, 0, 0, l.place[0], l.place[1], l.place[2]};
    const double pose[6] = {0, 0, 0, c.shift[0], c.shift[1], c.shift[2]};
    if (straight) {
        c.lens = RIG_LENS_POLYNOMIAL;
        std::fill(c.intrinsics + 4, c.intrinsics + BUNDLE_INTRINSICS, 0.0);
    }
    const bundle_parameters at = {c.intrinsics,   pose,           lay, s.angle_rad, bundle->bend,
                                  bundle->wobble, s.commanded_rad};
    return bundle_image(&c, &l, &at, board_mm, ret_px, nullptr);
}
