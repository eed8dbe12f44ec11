#include "bundle.h"

#include <ceres/ceres.h>
#include <ceres/rotation.h>

#include <glog/logging.h>

#include <Eigen/Dense>
#include <Eigen/Sparse>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iterator>
#include <map>
#include <set>
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
constexpr double LEAST_LEFT = 1e-6;      /* share of a residual that the fit must have left */

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

/* The lens models of rig.h; c = (fx, fy, cx, cy, k1, k2, k3, p1, p2, k4, k5, k6). */
template <typename T> bool project(rig_lens lens, const T *c, const T p[3], T ret[2]) {
    if (lens == RIG_LENS_FISHEYE) {
        const T across2 = p[0] * p[0] + p[1] * p[1];
        T scale = T(1) / p[2]; /* θ / |(x, y)| on the axis */
        if (across2 > T(1e-18)) {
            const T across = sqrt(across2), theta = atan2(across, p[2]), s = theta * theta;
            scale = theta * (T(1) + s * (c[4] + s * (c[5] + s * (c[6] + s * c[9])))) / across;
        } else if (!(p[2] > T(1e-6))) {
            return false;
        }
        ret[0] = c[0] * p[0] * scale + c[2];
        ret[1] = c[1] * p[1] * scale + c[3];
        return true;
    }
    if (!(p[2] > T(1e-6)))
        return false;
    const T x = p[0] / p[2], y = p[1] / p[2], s = x * x + y * y;
    T radial = T(1) + s * (c[4] + s * (c[5] + s * c[6]));
    if (lens == RIG_LENS_RATIONAL) {
        const T below = T(1) + s * (c[9] + s * (c[10] + s * c[11]));
        if (!(below > T(1e-3)))
            return false;
        radial /= below;
    }
    ret[0] = c[0] * (x * radial + T(2) * c[7] * x * y + c[8] * (s + T(2) * x * x)) + c[2];
    ret[1] = c[1] * (y * radial + c[7] * (s + T(2) * y * y) + T(2) * c[8] * x * y) + c[3];
    return true;
}

/* Whether a lens model has parameter i of its intrinsics. */
bool has(rig_lens lens, int i) {
    switch (lens) {
    case RIG_LENS_FISHEYE:
        return i < 7 || i == 9;
    case RIG_LENS_RATIONAL:
        return true;
    default:
        return i < 9;
    }
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
        if (!project(camera.lens, lens, q, px))
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
            std::vector<int> unused;
            for (int k = 0; k < BUNDLE_INTRINSICS; k++)
                if (!has(c.lens, k))
                    unused.push_back(k);
            if (c.fixed_lens)
                problem.SetParameterBlockConstant(lenses[i].data());
            else if (!unused.empty())
                problem.SetManifold(lenses[i].data(),
                                    new ceres::SubsetManifold(BUNDLE_INTRINSICS, unused));
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

using Sparse = Eigen::SparseMatrix<double, Eigen::RowMajor>;
using Columns = std::vector<int>;

/* Residuals and Jacobian at the solution, in the order in which they were added: first two rows for
 * each observation that is not rejected. at: as free_blocks() says. */
struct Linear {
    std::vector<int> at;
    std::vector<double> residuals;
    Sparse jacobian;

    explicit Linear(Work &work) {
        ceres::Problem::EvaluateOptions options;
        ceres::CRSMatrix j;
        int columns;
        options.parameter_blocks = work.free_blocks(&at, &columns);
        work.problem.Evaluate(options, nullptr, &residuals, nullptr, &j);
        jacobian = Eigen::Map<const Sparse>(j.num_rows, j.num_cols, (int)j.values.size(),
                                            j.rows.data(), j.cols.data(), j.values.data());
    }
};

/* Columns of a camera's parameters, in the order of its covariance; −1: fixed. */
Columns camera_columns(const bundle_camera &camera, int lens, int pose) {
    Columns columns(BUNDLE_CAMERA, -1), of_lens(BUNDLE_INTRINSICS, -1);
    for (int i = 0; i < BUNDLE_INTRINSICS && lens >= 0; i++)
        if (has(camera.lens, i))
            of_lens[(gsize)i] = lens++;
    for (gsize i = 0; i < BUNDLE_CAMERA; i++)
        columns[i] = i < 9    ? of_lens[i]
                     : i < 15 ? (pose < 0 ? -1 : pose + (int)i - 9)
                              : of_lens[i - 6];
    return columns;
}

/* A picture's part of the cluster-robust sum: G = J_iᵀ (I − J_i C J_iᵀ)^−½ r_i and J_iᵀ J_i over
 * the columns that the picture depends on. With J_i = Q R and R C Rᵀ = U diag(l) Uᵀ, G = Rᵀ U
 * diag((1 − l)^−½) Uᵀ Qᵀ r_i. Where l is 1, the fit follows whatever the picture says, and nothing
 * is left to learn from its residuals. */
struct Cluster {
    Columns columns;
    Eigen::VectorXd score;
    Eigen::MatrixXd expected;

    Cluster(const Linear &linear, const std::vector<int> &rows, const Eigen::MatrixXd &c) {
        std::vector<int> local((gsize)linear.jacobian.cols(), -1);
        for (int row : rows)
            for (Sparse::InnerIterator it(linear.jacobian, row); it; ++it)
                if (local[(gsize)it.col()] < 0) {
                    local[(gsize)it.col()] = (int)columns.size();
                    columns.push_back((int)it.col());
                }
        const Eigen::Index n = (Eigen::Index)columns.size();
        Eigen::MatrixXd j = Eigen::MatrixXd::Zero((Eigen::Index)rows.size(), n);
        Eigen::VectorXd r((Eigen::Index)rows.size());
        for (gsize i = 0; i < rows.size(); i++) {
            r((Eigen::Index)i) = linear.residuals[(gsize)rows[i]];
            for (Sparse::InnerIterator it(linear.jacobian, rows[i]); it; ++it)
                j((Eigen::Index)i, local[(gsize)it.col()]) = it.value();
        }
        Eigen::MatrixXd own(n, n);
        for (Eigen::Index a = 0; a < n; a++)
            for (Eigen::Index b = 0; b < n; b++)
                own(a, b) = c(columns[(gsize)a], columns[(gsize)b]);
        expected = j.transpose() * j;
        const Eigen::Index rank = std::min(j.rows(), n);
        const Eigen::HouseholderQR<Eigen::MatrixXd> qr(j);
        const Eigen::MatrixXd q = qr.householderQ() * Eigen::MatrixXd::Identity(j.rows(), rank);
        const Eigen::MatrixXd upper = q.transpose() * j;
        const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> eigen(upper * own * upper.transpose());
        const Eigen::VectorXd left = (1 - eigen.eigenvalues().array()).matrix();
        Eigen::VectorXd along = eigen.eigenvectors().transpose() * (q.transpose() * r);
        for (Eigen::Index i = 0; i < rank; i++)
            along(i) = left(i) > LEAST_LEFT ? along(i) / std::sqrt(left(i)) : 0;
        score = upper.transpose() * (eigen.eigenvectors() * along);
    }
};

/* The covariance of one camera's free parameters, from C and all pictures, and its inflation f. */
Eigen::MatrixXd clustered(const Eigen::MatrixXd &c, const Columns &free,
                          const std::vector<Cluster> &clusters, int pictures, double *ret_f) {
    const Eigen::Index p = (Eigen::Index)free.size();
    Eigen::MatrixXd rows(p, c.cols()), own(p, p);
    for (Eigen::Index i = 0; i < p; i++)
        rows.row(i) = c.row(free[(gsize)i]);
    for (Eigen::Index i = 0; i < p; i++)
        own.col(i) = rows.col(free[(gsize)i]);
    /* C J_pᵀ J_p C = C − Σ_i C J_iᵀ J_i C */
    Eigen::MatrixXd s = own;
    for (const Cluster &cluster : clusters) {
        const Eigen::Index n = (Eigen::Index)cluster.columns.size();
        Eigen::MatrixXd part(p, n);
        for (Eigen::Index i = 0; i < n; i++)
            part.col(i) = rows.col(cluster.columns[(gsize)i]);
        const Eigen::VectorXd u = part * cluster.score;
        s += u * u.transpose() - part * cluster.expected * part.transpose();
    }
    const Eigen::VectorXd scale = own.diagonal().array().max(1e-300).rsqrt();
    const Eigen::MatrixXd unit = scale.asDiagonal() * own * scale.asDiagonal();
    const Eigen::MatrixXd scaled = scale.asDiagonal() * s * scale.asDiagonal();
    *ret_f = std::max(unit.ldlt().solve(scaled).trace() / (double)p, 1.0);
    const double n = pictures, q = (double)p;
    return (n * s + q * *ret_f * own) / (n + q);
}

void take_camera(bundle_camera *camera, const Eigen::MatrixXd &covariance, const Columns &columns) {
    Columns row(BUNDLE_CAMERA, -1);
    int used = 0;
    for (gsize i = 0; i < BUNDLE_CAMERA; i++)
        row[i] = columns[i] < 0 ? -1 : used++;
    for (gsize i = 0; i < BUNDLE_CAMERA; i++)
        for (gsize k = 0; k < BUNDLE_CAMERA; k++)
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
        options.max_num_iterations = bundle->coarse ? 30 : 100;
        options.function_tolerance = bundle->coarse ? 1e-5 : 1e-12;
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

gboolean bundle_covariance(struct bundle *bundle, double *ret_inflation, GError **error) {
    try {
        Work work(bundle);
        const Linear linear(work);
        const Eigen::MatrixXd h =
            Eigen::MatrixXd(Sparse(linear.jacobian.transpose()) * linear.jacobian);
        /* Scaled to a unit diagonal, since units differ by orders of magnitude. */
        const Eigen::VectorXd scale = h.diagonal().array().max(1e-300).rsqrt();
        const Eigen::MatrixXd scaled = scale.asDiagonal() * h * scale.asDiagonal();
        const Eigen::LLT<Eigen::MatrixXd> llt(scaled);
        if (llt.info() != Eigen::Success || llt.rcond() < 1e-15)
            return fail(error, BUNDLE_ERROR_SINGULAR,
                        "the observations do not determine all parameters");
        const Eigen::MatrixXd inverse = llt.solve(Eigen::MatrixXd::Identity(h.rows(), h.cols()));
        const Eigen::MatrixXd c = scale.asDiagonal() * inverse * scale.asDiagonal();
        std::map<int, std::vector<int>> pictures; /* rows of each */
        std::vector<std::set<int>> seen((gsize)bundle->n_cameras);
        int row = 0;
        for (int i = 0; i < bundle->n_observations; i++) {
            const bundle_observation &o = bundle->observations[i];
            if (o.rejected)
                continue;
            pictures[o.picture].push_back(row++);
            pictures[o.picture].push_back(row++);
            seen[(gsize)o.camera].insert(o.picture);
        }
        std::vector<Cluster> clusters;
        for (const auto &picture : pictures)
            clusters.emplace_back(linear, picture.second, c);
        for (gsize i = 0; i < seen.size(); i++) {
            bundle_camera *camera = &bundle->cameras[i];
            const Columns columns = camera_columns(*camera, linear.at[2 * i], linear.at[2 * i + 1]);
            Columns free;
            double f = 1;
            std::copy_if(columns.begin(), columns.end(), std::back_inserter(free),
                         [](int column) { return column >= 0; });
            take_camera(camera,
                        free.empty() ? Eigen::MatrixXd()
                                     : clustered(c, free, clusters, (int)seen[i].size(), &f),
                        columns);
            if (ret_inflation)
                ret_inflation[i] = f;
        }
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
    const rig_lens model = straight ? RIG_LENS_POLYNOMIAL : c.lens;
    place(l.rotation, lay, s.angle_rad, board_mm, p);
    rotate(c.rotation, zero, p, q);
    for (int i = 0; i < 3; i++)
        q[i] += c.shift[i];
    return project(model, lens, q, ret_px);
}
