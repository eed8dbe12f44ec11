#include "bundle.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <glog/logging.h>

#include <Eigen/Dense>
#include <Eigen/Sparse>

#include <cmath>
#include <cstring>
#include <vector>

G_DEFINE_QUARK(bundle_error, bundle_error)

namespace {

/* Failures are reported as errors, not on stderr. */
const bool quiet = [] {
    FLAGS_minloglevel = google::GLOG_FATAL;
    if (!google::IsGoogleLoggingInitialized())
        google::InitGoogleLogging("mesorig");
    return true;
}();

constexpr double GAUGE_SIGMA_RAD = 1e-7; /* of the gauge constraints: practically exact */
constexpr double ASPECT_SIGMA = 0.002;   /* of fx / fy about the prior's */

/* v = R₀ exp([ω]×) p; R₀ row by row. */
template <typename T> void rotate(const double r0[9], const T *omega, const T p[3], T v[3]) {
    T q[3];
    ceres::AngleAxisRotatePoint(omega, p, q);
    for (int i = 0; i < 3; i++)
        v[i] = r0[3 * i] * q[0] + r0[3 * i + 1] * q[1] + r0[3 * i + 2] * q[2];
}

/* A board point in the rig frame: p = Rz(τ) (R_l X + t_l) with lay = (ω, t_x, t_y, h). From the
 * height h of the print's plane on the axis, t_z = h − (n_x t_x + n_y t_y) / n_z, n being the
 * board's normal. */
template <typename T>
void place(const double r0[9], const T *lay, const T &angle, const double board[2], T ret[3]) {
    const T x[3] = {T(board[0]), T(board[1]), T(0)}, up[3] = {T(0), T(0), T(1)};
    T p[3], n[3];
    rotate(r0, lay, x, p);
    rotate(r0, lay, up, n);
    p[0] += lay[3];
    p[1] += lay[4];
    p[2] += lay[5] - (n[0] * lay[3] + n[1] * lay[4]) / n[2];
    const T c = cos(angle), s = sin(angle);
    ret[0] = c * p[0] - s * p[1];
    ret[1] = s * p[0] + c * p[1];
    ret[2] = p[2];
}

/* Brown's distortion model as in rig.h; lens = (fx, fy, cx, cy, k1, k2, k3, p1, p2). */
template <typename T> bool project(const T *lens, const T p[3], T ret[2]) {
    if (!(p[2] > T(1e-6)))
        return false;
    const T x = p[0] / p[2], y = p[1] / p[2], s = x * x + y * y;
    const T radial = T(1) + s * (lens[4] + s * (lens[5] + s * lens[6]));
    ret[0] =
        lens[0] * (x * radial + T(2) * lens[7] * x * y + lens[8] * (s + T(2) * x * x)) + lens[2];
    ret[1] =
        lens[1] * (y * radial + lens[7] * (s + T(2) * y * y) + T(2) * lens[8] * x * y) + lens[3];
    return true;
}

struct Reprojection {
    const bundle *b;
    const bundle_observation *o;

    template <typename T>
    bool operator()(const T *lens, const T *pose, const T *lay, const T *angle, T *residual) const {
        const bundle_camera &camera = b->cameras[o->camera];
        T p[3], q[3], px[2];
        place(b->lays[b->stops[o->stop].lay].rotation, lay, angle[0], o->board_mm, p);
        rotate(camera.rotation, pose, p, q);
        for (int i = 0; i < 3; i++)
            q[i] += pose[3 + i];
        if (!project(lens, q, px))
            return false;
        const T d[2] = {px[0] - o->seen_px[0], px[1] - o->seen_px[1]};
        const double noise = camera.noise * o->noise;
        residual[0] = (o->whiten[0][0] * d[0] + o->whiten[0][1] * d[1]) / noise;
        residual[1] = (o->whiten[1][0] * d[0] + o->whiten[1][1] * d[1]) / noise;
        return true;
    }
};

struct LensPrior {
    const bundle_camera *camera;

    template <typename T> bool operator()(const T *lens, T *residual) const {
        for (int i = 0; i < BUNDLE_INTRINSICS; i++)
            residual[i] = camera->prior_sigma[i] > 0
                              ? (lens[i] - camera->prior[i]) / camera->prior_sigma[i]
                              : T(0);
        residual[BUNDLE_INTRINSICS] =
            (lens[0] / lens[1] - camera->prior[0] / camera->prior[1]) / ASPECT_SIGMA;
        return true;
    }
};

struct AnglePrior {
    double commanded, sigma;
    template <typename T> bool operator()(const T *angle, T *residual) const {
        residual[0] = (angle[0] - commanded) / sigma;
        return true;
    }
};

/* Gauge: the mean deviation of a lay's angles from the commanded ones is 0. */
struct MeanAngle {
    std::vector<double> commanded;
    template <typename T> bool operator()(T const *const *angles, T *residual) const {
        T sum(0);
        for (gsize i = 0; i < commanded.size(); i++)
            sum += angles[i][0] - commanded[i];
        residual[0] = sum / ((double)commanded.size() * GAUGE_SIGMA_RAD);
        return true;
    }
};

/* Gauge: the mean azimuth of the cameras' centres, relative to the nominal ones, is 0: Σ (c ×
 * n)_z / |n|² = 0, c and n being true and nominal centre. */
struct MeanAzimuth {
    std::vector<const bundle_camera *> cameras;
    template <typename T> bool operator()(T const *const *poses, T *residual) const {
        T sum(0);
        for (gsize k = 0; k < cameras.size(); k++) {
            const bundle_camera &c = *cameras[k];
            T v[3], minus[3], centre[3];
            for (int i = 0; i < 3; i++) /* R₀ᵀ shift */
                v[i] = c.rotation[i] * poses[k][3] + c.rotation[3 + i] * poses[k][4] +
                       c.rotation[6 + i] * poses[k][5];
            for (int i = 0; i < 3; i++)
                minus[i] = -poses[k][i];
            ceres::AngleAxisRotatePoint(minus, v, centre);
            const double *n = c.nominal_centre, r2 = n[0] * n[0] + n[1] * n[1];
            sum += (-centre[1] * n[0] + centre[0] * n[1]) / r2;
        }
        residual[0] = sum / ((double)cameras.size() * GAUGE_SIGMA_RAD);
        return true;
    }
};

/* The parameter blocks and the problem as Ceres wants them. */
struct Work {
    bundle *b;
    std::vector<std::array<double, BUNDLE_INTRINSICS>> lenses;
    std::vector<std::array<double, 6>> poses, lays;
    std::vector<double> angles;
    std::vector<int> of_lay, of_stop, of_camera; /* number of observations of each */
    ceres::Problem problem;

    explicit Work(bundle *from)
        : b(from), lenses((gsize)b->n_cameras), poses(lenses.size()), lays((gsize)b->n_lays),
          angles((gsize)b->n_stops), of_lay(lays.size()), of_stop(angles.size()),
          of_camera(lenses.size()) {
        for (gsize i = 0; i < lenses.size(); i++) {
            const bundle_camera &c = b->cameras[i];
            std::memcpy(lenses[i].data(), c.intrinsics, sizeof c.intrinsics);
            poses[i] = {0, 0, 0, c.shift[0], c.shift[1], c.shift[2]};
        }
        for (gsize i = 0; i < lays.size(); i++)
            lays[i] = {0, 0, 0, b->lays[i].place[0], b->lays[i].place[1], b->lays[i].place[2]};
        for (gsize i = 0; i < angles.size(); i++)
            angles[i] = b->stops[i].angle_rad;
        add_observations();
        add_cameras();
        add_turntable();
    }

    void add_observations() {
        for (int i = 0; i < b->n_observations; i++) {
            const bundle_observation &o = b->observations[i];
            if (o.rejected)
                continue;
            const gsize camera = (gsize)o.camera, stop = (gsize)o.stop,
                        lay = (gsize)b->stops[stop].lay;
            of_camera[camera]++;
            of_stop[stop]++;
            of_lay[lay]++;
            problem.AddResidualBlock(
                new ceres::AutoDiffCostFunction<Reprojection, 2, BUNDLE_INTRINSICS, 6, 6, 1>(
                    new Reprojection{b, &o}),
                b->robust > 0 ? new ceres::HuberLoss(b->robust) : nullptr, lenses[camera].data(),
                poses[camera].data(), lays[lay].data(), &angles[stop]);
        }
    }

    void add_cameras() {
        MeanAzimuth mean;
        std::vector<double *> blocks;
        for (gsize i = 0; i < lenses.size(); i++) {
            const bundle_camera &c = b->cameras[i];
            const double *n = c.nominal_centre;
            if (of_camera[i] == 0)
                continue;
            problem.AddResidualBlock(
                new ceres::AutoDiffCostFunction<LensPrior, BUNDLE_INTRINSICS + 1,
                                                BUNDLE_INTRINSICS>(new LensPrior{&c}),
                nullptr, lenses[i].data());
            if (c.fixed_pose)
                problem.SetParameterBlockConstant(poses[i].data());
            if (c.fixed_lens)
                problem.SetParameterBlockConstant(lenses[i].data());
            if (std::hypot(n[0], n[1]) < 0.1 * std::fabs(n[2]))
                continue; /* the azimuth of a camera near the zenith is undetermined */
            mean.cameras.push_back(&c);
            blocks.push_back(poses[i].data());
        }
        if (b->fix_azimuth)
            add_gauge(mean, blocks, 6);
    }

    /* A residual of all of these blocks, of `size` parameters each. */
    template <typename Mean>
    void add_gauge(const Mean &mean, const std::vector<double *> &blocks, int size) {
        if (blocks.empty())
            return;
        auto cost = new ceres::DynamicAutoDiffCostFunction<Mean>(new Mean(mean));
        for (gsize i = 0; i < blocks.size(); i++)
            cost->AddParameterBlock(size);
        cost->SetNumResiduals(1);
        problem.AddResidualBlock(cost, nullptr, blocks);
    }

    void add_turntable() {
        for (gsize l = 0; l < lays.size(); l++) {
            MeanAngle mean;
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
                mean.commanded.push_back(stop.commanded_rad);
                blocks.push_back(&angles[i]);
            }
            if (b->fix_azimuth)
                add_gauge(mean, blocks, 1);
        }
        for (gsize i = 0; i < angles.size(); i++) {
            if (of_stop[i] == 0)
                continue;
            if (b->stops[i].sigma_rad > 0)
                problem.AddResidualBlock(
                    new ceres::AutoDiffCostFunction<AnglePrior, 1, 1>(
                        new AnglePrior{b->stops[i].commanded_rad, b->stops[i].sigma_rad}),
                    nullptr, &angles[i]);
            else
                problem.SetParameterBlockConstant(&angles[i]);
        }
    }

    /* Copies the parameters back; the rotation vectors ω are multiplied into R₀. */
    void keep() {
        for (gsize i = 0; i < lenses.size(); i++) {
            bundle_camera &c = b->cameras[i];
            std::memcpy(c.intrinsics, lenses[i].data(), sizeof c.intrinsics);
            compose(c.rotation, poses[i].data());
            std::memcpy(c.shift, &poses[i][3], sizeof c.shift);
        }
        for (gsize i = 0; i < lays.size(); i++) {
            compose(b->lays[i].rotation, lays[i].data());
            std::memcpy(b->lays[i].place, &lays[i][3], sizeof b->lays[i].place);
        }
        for (gsize i = 0; i < angles.size(); i++)
            b->stops[i].angle_rad = angles[i];
    }

    static void compose(double rotation[9], const double omega[3]) {
        double r[9];
        ceres::AngleAxisToRotationMatrix(omega, ceres::RowMajorAdapter3x3(r));
        using Matrix = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
        const Matrix product = Eigen::Map<const Matrix>(rotation) * Eigen::Map<const Matrix>(r);
        /* Rounding accumulates over many solves: project to the nearest rotation. */
        const Eigen::JacobiSVD<Eigen::Matrix3d> svd(product,
                                                    Eigen::ComputeFullU | Eigen::ComputeFullV);
        Eigen::Map<Matrix> to(rotation);
        to = svd.matrixU() * svd.matrixV().transpose();
    }

    /* All free parameter blocks in order, and the first column of each in J; −1: fixed. */
    std::vector<double *> free_blocks(std::vector<int> *at, int *columns) {
        std::vector<double *> blocks;
        *columns = 0;
        const auto add = [&](double *block, bool used) {
            const bool taken = used && !problem.IsParameterBlockConstant(block);
            at->push_back(taken ? *columns : -1);
            if (!taken)
                return;
            blocks.push_back(block);
            *columns += problem.ParameterBlockTangentSize(block);
        };
        for (gsize i = 0; i < lenses.size(); i++) {
            add(lenses[i].data(), of_camera[i] > 0);
            add(poses[i].data(), of_camera[i] > 0);
        }
        for (gsize i = 0; i < lays.size(); i++)
            add(lays[i].data(), of_lay[i] > 0);
        for (gsize i = 0; i < angles.size(); i++)
            add(&angles[i], of_stop[i] > 0);
        return blocks;
    }
};

/* JᵀJ as a dense matrix: there are a few hundred parameters at most. */
Eigen::MatrixXd normal_matrix(Work &work, std::vector<int> *at) {
    ceres::Problem::EvaluateOptions options;
    ceres::CRSMatrix j;
    int columns;
    options.parameter_blocks = work.free_blocks(at, &columns);
    work.problem.Evaluate(options, nullptr, nullptr, nullptr, &j);
    const Eigen::Map<const Eigen::SparseMatrix<double, Eigen::RowMajor>> jacobian(
        j.num_rows, j.num_cols, (int)j.values.size(), j.rows.data(), j.cols.data(),
        j.values.data());
    const Eigen::SparseMatrix<double> product = jacobian.transpose() * jacobian;
    return Eigen::MatrixXd(product);
}

void take_camera(bundle_camera *camera, const Eigen::MatrixXd &covariance, int lens, int pose) {
    int row[15];
    for (int i = 0; i < 15; i++)
        row[i] = i < 9 ? (lens < 0 ? -1 : lens + i) : (pose < 0 ? -1 : pose + i - 9);
    for (int i = 0; i < 15; i++)
        for (int k = 0; k < 15; k++)
            camera->covariance[i][k] =
                row[i] < 0 || row[k] < 0
                    ? 0
                    : (covariance(row[i], row[k]) + covariance(row[k], row[i])) / 2;
}

gboolean fail(GError **error, int code, const char *why) {
    g_set_error(error, BUNDLE_ERROR, code, "the joint refinement has failed: %s", why);
    return FALSE;
}

} // namespace

gboolean bundle_solve(struct bundle *bundle, GError **error) {
    try {
        Work work(bundle);
        ceres::Solver::Options options;
        ceres::Solver::Summary summary;
        options.linear_solver_type = ceres::SPARSE_NORMAL_CHOLESKY;
        options.max_num_iterations = 100;
        options.function_tolerance = 1e-12;
        options.parameter_tolerance = 1e-12;
        options.num_threads = 2;
        options.logging_type = ceres::SILENT;
        ceres::Solve(options, &work.problem, &summary);
        if (!summary.IsSolutionUsable())
            return fail(error, BUNDLE_ERROR_FAILED, summary.message.c_str());
        work.keep();
        return TRUE;
    } catch (const std::exception &e) {
        return fail(error, BUNDLE_ERROR_FAILED, e.what());
    }
}

gboolean bundle_covariance(struct bundle *bundle, GError **error) {
    try {
        Work work(bundle);
        std::vector<int> at;
        const Eigen::MatrixXd h = normal_matrix(work, &at);
        /* Scaled to a unit diagonal, since units differ by orders of magnitude. */
        const Eigen::VectorXd scale = h.diagonal().array().max(1e-300).rsqrt();
        const Eigen::MatrixXd scaled = scale.asDiagonal() * h * scale.asDiagonal();
        const Eigen::LLT<Eigen::MatrixXd> llt(scaled);
        if (llt.info() != Eigen::Success || llt.rcond() < 1e-15)
            return fail(error, BUNDLE_ERROR_SINGULAR,
                        "the observations do not determine all parameters");
        const Eigen::MatrixXd inverse = llt.solve(Eigen::MatrixXd::Identity(h.rows(), h.cols()));
        const Eigen::MatrixXd covariance = scale.asDiagonal() * inverse * scale.asDiagonal();
        for (int i = 0; i < bundle->n_cameras; i++)
            take_camera(&bundle->cameras[i], covariance, at[(gsize)(2 * i)],
                        at[(gsize)(2 * i + 1)]);
        return TRUE;
    } catch (const std::exception &e) {
        return fail(error, BUNDLE_ERROR_FAILED, e.what());
    }
}

gboolean bundle_project(const struct bundle *bundle, int camera, int stop, gboolean straight,
                        const double board_mm[2], double ret_px[2]) {
    static const double zero[3] = {0, 0, 0};
    const bundle_camera &c = bundle->cameras[camera];
    const bundle_stop &s = bundle->stops[stop];
    const bundle_lay &l = bundle->lays[s.lay];
    const double lay[6] = {0, 0, 0, l.place[0], l.place[1], l.place[2]};
    double lens[BUNDLE_INTRINSICS] = {0}, p[3], q[3];
    std::memcpy(lens, c.intrinsics, straight ? 4 * sizeof(double) : sizeof lens);
    place(l.rotation, lay, s.angle_rad, board_mm, p);
    rotate(c.rotation, zero, p, q);
    for (int i = 0; i < 3; i++)
        q[i] += c.shift[i];
    return project(lens, q, ret_px);
}
