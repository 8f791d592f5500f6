// MuJoCo's smooth dynamics over a batch of states, rows of arrays, on one core: of its pipeline what the result needs.
#include <mujoco/mujoco.h>

#include <cstring>
#include <vector>

static mjModel* model;
static mjData* data;

extern "C" int load(const char* path) {
  model = mj_loadModel(path, nullptr);
  data = mj_makeData(model);
  return model->nv;
}

extern "C" void run(int algorithm, long n, const double* q, const double* v, const double* a, double* out) {
  const int nq = model->nq, nv = model->nv;
  std::vector<double> rest(nv);
  for (long i = 0; i < n; ++i) {
    std::memcpy(data->qpos, q + i * nq, nq * sizeof(double));
    std::memcpy(data->qvel, v + i * nv, nv * sizeof(double));
    mj_kinematics(model, data);
    mj_comPos(model, data);
    if (algorithm == 0) {
      std::memcpy(data->qacc, a + i * nv, nv * sizeof(double));
      mj_comVel(model, data);
      mj_rne(model, data, 1, out + i * nv);
    } else {
      mj_makeM(model, data);
      mj_factorM(model, data);
      mj_comVel(model, data);
      mj_rne(model, data, 0, rest.data());
      for (int k = 0; k < nv; ++k) rest[k] = a[i * nv + k] - rest[k];
      mj_solveM(model, data, out + i * nv, rest.data(), 1);
    }
  }
}
