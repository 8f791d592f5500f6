// Pinocchio's recursions over a batch of states, rows of arrays, on one core: as a C++ program would call them.
#include <pinocchio/algorithm/aba.hpp>
#include <pinocchio/algorithm/rnea.hpp>
#include <pinocchio/serialization.hpp>

namespace pin = pinocchio;
using T = SCALAR;
using Model = pin::ModelTpl<SCALAR>;
using Rows = Eigen::Map<const Eigen::Matrix<T, Eigen::Dynamic, 1>>;
using Out = Eigen::Map<Eigen::Matrix<T, Eigen::Dynamic, 1>>;

static Model model;
static pin::DataTpl<T>* data;

extern "C" int load(const char* path) {
  pin::Model read;
  pin::serialization::loadFromBinary(read, path);
  model = read.cast<T>();
  data = new pin::DataTpl<T>(model);
  return model.nv;
}

extern "C" void run(int algorithm, long n, const T* q, const T* v, const T* a, T* out) {
  const int nq = model.nq, nv = model.nv;
  for (long i = 0; i < n; ++i) {
    Rows qi(q + i * nq, nq), vi(v + i * nv, nv), ai(a + i * nv, nv);
    if (algorithm == 0) Out(out + i * nv, nv) = pin::rnea(model, *data, qi, vi, ai);
    if (algorithm == 1) Out(out + i * nv, nv) = pin::aba(model, *data, qi, vi, ai);
  }
}
