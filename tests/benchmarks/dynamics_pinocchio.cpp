// Pinocchio's algorithms over a batch of states, rows of arrays, on one core: as a C++ program would call them.
#include <pinocchio/algorithm/aba-derivatives.hpp>
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/cholesky.hpp>
#include <pinocchio/algorithm/crba.hpp>
#include <pinocchio/algorithm/frames.hpp>
#include <pinocchio/algorithm/joint-configuration.hpp>
#include <pinocchio/algorithm/kinematics.hpp>
#include <pinocchio/algorithm/regressor.hpp>
#include <pinocchio/algorithm/rnea-derivatives.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/serialization.hpp>

namespace pin = pinocchio;
using T = SCALAR;
using Model = pin::ModelTpl<T>;
using Vector = Eigen::Matrix<T, Eigen::Dynamic, 1>;
using Matrix = Eigen::Matrix<T, Eigen::Dynamic, Eigen::Dynamic>;
using Row = Eigen::Map<const Vector>;
using Out = Eigen::Map<Vector>;
using OutMatrix = Eigen::Map<Matrix>;  // by columns, as Pinocchio keeps its own

static Model model;
static pin::DataTpl<T>* data;
static int frame;
static Eigen::Matrix<T, 6, Eigen::Dynamic> J_of_tip;
static const T dt = T(0.002);

extern "C" int load(const char* path, int frame_of_jacobian) {
  pin::Model read;
  pin::serialization::loadFromBinary(read, path);
  model = read.cast<T>();
  data = new pin::DataTpl<T>(model);
  frame = frame_of_jacobian;
  J_of_tip.resize(6, model.nv);
  return model.nv;
}

static void inverse_dynamics(const Row& q, const Row& v, const Row& a, const Row&, T* out) {
  Out(out, model.nv) = pin::rnea(model, *data, q, v, a);
}

static void forward_dynamics(const Row& q, const Row& v, const Row& tau, const Row&, T* out) {
  Out(out, model.nv) = pin::aba(model, *data, q, v, tau);
}

// The upper triangle, which is what it computes.
static void mass_matrix(const Row& q, const Row&, const Row&, const Row&, T* out) {
  OutMatrix(out, model.nv, model.nv) = pin::crba(model, *data, q);
}

static void kinematics(const Row& q, const Row&, const Row&, const Row&, T* out) {
  pin::forwardKinematics(model, *data, q);
  for (int i = 1; i < model.njoints; ++i, out += 12) {
    OutMatrix(out, 3, 3) = data->oMi[i].rotation();
    Out(out + 9, 3) = data->oMi[i].translation();
  }
}

static void jacobian(const Row& q, const Row&, const Row&, const Row&, T* out) {
  Eigen::Map<Eigen::Matrix<T, 6, Eigen::Dynamic>> J(out, 6, model.nv);
  J.setZero();
  pin::computeFrameJacobian(model, *data, q, frame, pin::LOCAL_WORLD_ALIGNED, J);
}

// Templates, for Pinocchio keeps some by rows and some by columns: a Matrix would be one more copy of those by rows.
template <typename X, typename Z>
static void three(const X& x, const X& y, const Z& z, T* out) {
  const int nv = model.nv;
  OutMatrix(out, nv, nv) = x;
  OutMatrix(out + nv * nv, nv, nv) = y;
  OutMatrix(out + 2 * nv * nv, nv, nv) = z;
}

static void inverse_dynamics_derivatives(const Row& q, const Row& v, const Row& a, const Row&, T* out) {
  pin::computeRNEADerivatives(model, *data, q, v, a);
  three(data->dtau_dq, data->dtau_dv, data->M, out);
}

static void forward_dynamics_derivatives(const Row& q, const Row& v, const Row& tau, const Row&, T* out) {
  pin::computeABADerivatives(model, *data, q, v, tau);
  three(data->ddq_dq, data->ddq_dv, data->Minv, out);
}

// Its derivatives, times what comes back: the gradient as a user of it writes it.
static void gradient_of_forward_dynamics(const Row& q, const Row& v, const Row& tau, const Row& c, T* out) {
  const int nv = model.nv;
  pin::computeABADerivatives(model, *data, q, v, tau);
  Out(out, nv).noalias() = data->ddq_dq.transpose() * c;
  Out(out + nv, nv).noalias() = data->ddq_dv.transpose() * c;
  Out(out + 2 * nv, nv).noalias() = data->Minv.template selfadjointView<Eigen::Upper>() * c;
}

// Of the whole batch: added up.
static void gradient_by_inertias(const Row& q, const Row& v, const Row& a, const Row& c, T* out) {
  const auto& Y = pin::computeJointTorqueRegressor(model, *data, q, v, a);
  Out(out, Y.cols()).noalias() += Y.transpose() * c;
}

static void step(const Row& q, const Row& v, const Row& tau, const Row&, T* out) {
  Out after(out + model.nq, model.nv);
  after = v + dt * pin::aba(model, *data, q, v, tau);
  const Vector moved = dt * after;
  Out q_after(out, model.nq);
  pin::integrate(model, q, moved, q_after);
}

// -- matrices times vectors: c is what M and its inverse are multiplied by, its first six numbers are a wrench, and
// (c, a, v) are the directions of derivatives by (q, v, a).

static void mass_matrix_times(const Row& q, const Row&, const Row&, const Row& c, T* out) {
  Out(out, model.nv).noalias() = pin::crba(model, *data, q).template selfadjointView<Eigen::Upper>() * c;
}

// The fastest of its ways: computeMinverse and a product take longer, and so does aba from rest without gravity.
static void inverse_mass_matrix_times(const Row& q, const Row&, const Row&, const Row& c, T* out) {
  Out x(out, model.nv);
  x = c;
  pin::crba(model, *data, q);
  pin::cholesky::decompose(model, *data);
  pin::cholesky::solve(model, *data, x);
}

// Torque is on top of force in a wrench here, as in the coordinates of a floating base; there force is on top.
static void jacobian_transposed_times(const Row& q, const Row&, const Row&, const Row& c, T* out) {
  const int force = model.joints[1].nv() == 6 ? 0 : 3;
  Eigen::Matrix<T, 6, 1> wrench;
  wrench << c.template segment<3>(force), c.template segment<3>(3 - force);
  J_of_tip.setZero();
  pin::computeFrameJacobian(model, *data, q, frame, pin::LOCAL_WORLD_ALIGNED, J_of_tip);
  Out(out, model.nv).noalias() = J_of_tip.transpose() * wrench;
}

// The third is symmetric.
template <typename X, typename Z>
static void times(const X& x, const X& y, const Z& z, const Row& v, const Row& a, const Row& c, T* out) {
  Out sum(out, model.nv);
  sum.noalias() = x * c;
  sum.noalias() += y * a;
  sum.noalias() += z.template selfadjointView<Eigen::Upper>() * v;
}

static void inverse_dynamics_derivatives_times(const Row& q, const Row& v, const Row& a, const Row& c, T* out) {
  pin::computeRNEADerivatives(model, *data, q, v, a);
  times(data->dtau_dq, data->dtau_dv, data->M, v, a, c, out);
}

static void forward_dynamics_derivatives_times(const Row& q, const Row& v, const Row& tau, const Row& c, T* out) {
  pin::computeABADerivatives(model, *data, q, v, tau);
  times(data->ddq_dq, data->ddq_dv, data->Minv, v, tau, c, out);
}

using Algorithm = void (*)(const Row&, const Row&, const Row&, const Row&, T*);
static const Algorithm ALGORITHMS[] = {
    inverse_dynamics, forward_dynamics, mass_matrix, kinematics, jacobian, inverse_dynamics_derivatives,
    forward_dynamics_derivatives, gradient_of_forward_dynamics, gradient_by_inertias, step,
    mass_matrix_times, mass_matrix_times,  // where ours differ: by the matrix, and without
    inverse_mass_matrix_times,
    jacobian_transposed_times, jacobian_transposed_times,
    inverse_dynamics_derivatives_times, inverse_dynamics_derivatives_times,
    forward_dynamics_derivatives_times, forward_dynamics_derivatives_times,
};

// size: numbers of a state's result; 0 for one result of all states.
extern "C" void run(int algorithm, long n, long size, const T* q, const T* v, const T* a, const T* c, T* out) {
  const int nq = model.nq, nv = model.nv;
  if (!size) Out(out, 10 * (model.njoints - 1)).setZero();
  for (long i = 0; i < n; ++i) {
    const Row qi(q + i * nq, nq), vi(v + i * nv, nv), ai(a + i * nv, nv), ci(c + i * nv, nv);
    ALGORITHMS[algorithm](qi, vi, ai, ci, out + i * size);
  }
}
