// Inverse kinematics and dynamics with closed loops by Pinocchio, over a batch of states, rows of arrays, on one core.
#include <pinocchio/algorithm/constrained-dynamics.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/jacobian.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/serialization.hpp>
#include <pinocchio/spatial.hpp>

namespace pin = pinocchio;
using T = SCALAR;
using Model = pin::ModelTpl<T>;
using Vector = Eigen::Matrix<T, Eigen::Dynamic, 1>;
using SE3 = pin::SE3Tpl<T>;
using Matrix3 = Eigen::Matrix<T, 3, 3>;
using Matrix6 = Eigen::Matrix<T, 6, 6>;
using Vector6 = Eigen::Matrix<T, 6, 1>;
using Row = Eigen::Map<const Vector>;
using Out = Eigen::Map<Vector>;

static Model model;
static pin::DataTpl<T>* data;
static int frame;
static std::vector<pin::RigidConstraintModelTpl<T>> closures;
static std::vector<pin::RigidConstraintDataTpl<T>> of_closures;

extern "C" void load(const char* path, int frame_at_target) {
  pin::Model read;
  pin::serialization::loadFromBinary(read, path);
  model = read.cast<T>();
  delete data;
  data = new pin::DataTpl<T>(model);
  frame = frame_at_target;
  closures.clear();
  of_closures.clear();
}

static SE3 pose(const T* x) {  // a rotation by rows, and a position
  return SE3(Eigen::Map<const Eigen::Matrix<T, 3, 3, Eigen::RowMajor>>(x), Eigen::Map<const Eigen::Matrix<T, 3, 1>>(x + 9));
}

extern "C" void add_closure(int is_weld, int joint_a, const T* in_a, int joint_b, const T* in_b) {
  const auto kind = is_weld ? pin::CONTACT_6D : pin::CONTACT_3D;
  closures.emplace_back(kind, model, joint_a, pose(in_a), joint_b, pose(in_b), pin::LOCAL);
  of_closures.emplace_back(closures.back());
  pin::initConstraintDynamics(model, *data, closures, of_closures);
}

extern "C" void constrained_dynamics(long n, const T* q, const T* v, const T* tau, T accuracy, T mu, int most, T* out) {
  const int nq = model.nq, nv = model.nv;
  for (long i = 0; i < n; ++i) {
    pin::ProximalSettingsTpl<T> settings(accuracy, accuracy, mu, most);
    const Row qi(q + i * nq, nq), vi(v + i * nv, nv), ti(tau + i * nv, nv);
    Out(out + i * nv, nv) = pin::constraintDynamics(model, *data, qi, vi, ti, closures, of_closures, settings);
  }
}

// The steps of `js.inverse_kinematics`, of which `damping` is the largest: dq = J^T (J J^T + d)^-1 e, rows of positions
// in units of the robot's length, joints at their limits at rest. steps: how many each state took.
extern "C" void inverse_kinematics(long n, const T* q, const T* targets, int most, T angle, T distance, T damping,
                                   T longest, T* out, int* steps) {
  const int nq = model.nq, nv = model.nv;
  Eigen::Matrix<T, 6, Eigen::Dynamic> J(6, nv), A(6, nv);
  Vector dq(nv), x(nq), moved(nq), pull(nv);
  for (long i = 0; i < n; ++i) {
    x = Row(q + i * nq, nq).cwiseMax(model.lowerPositionLimit).cwiseMin(model.upperPositionLimit);
    const SE3 target = pose(targets + 12 * i);
    int k = 0;
    for (;; ++k) {
      pin::computeJointJacobians(model, *data, x);
      pin::updateFramePlacement(model, *data, frame);
      Vector6 e = pin::log6(data->oMf[frame].actInv(target)).toVector();
      const bool is_solved = e.template head<3>().norm() <= distance && e.template tail<3>().norm() <= angle;
      if (is_solved || k == most) break;
      J.setZero();
      pin::getFrameJacobian(model, *data, frame, pin::LOCAL, J);
      const T length = std::sqrt(J.template topRows<3>().squaredNorm() / J.template bottomRows<3>().squaredNorm());
      A = J;
      A.template topRows<3>() /= length;
      e.template head<3>() /= length;
      pull.noalias() = A.transpose() * e;
      for (int j = 0; j < nv; ++j) {
        const bool is_held = pull[j] < 0 ? x[j] <= model.lowerPositionLimit[j] : x[j] >= model.upperPositionLimit[j];
        if (is_held) A.col(j).setZero();
      }
      const T d = (damping * std::min(e.squaredNorm(), T(1)) + 32 * std::numeric_limits<T>::epsilon()) * A.squaredNorm() / 6;
      Matrix6 square;
      square.noalias() = A * A.transpose();
      square.diagonal().array() += d;
      const Vector6 y = square.llt().solve(e);
      dq.noalias() = A.transpose() * y;
      dq *= longest / std::max(dq.norm(), longest);
      pin::integrate(model, x, dq, moved);
      x = moved.cwiseMax(model.lowerPositionLimit).cwiseMin(model.upperPositionLimit);
    }
    Out(out + i * nq, nq) = x;
    steps[i] = k;
  }
}
