// MuJoCo's smooth dynamics over a batch of states, rows of arrays, on one core: of its pipeline what the result needs.
#include <mujoco/mujoco.h>

#include <cstring>
#include <vector>

static mjModel* model;
static mjData* data;
static int body;

extern "C" int load(const char* path, int body_of_jacobian) {
  model = mj_loadModel(path, nullptr);
  data = mj_makeData(model);
  body = body_of_jacobian;
  return model->nv;
}

static void copy(double* to, const double* from, long n) { std::memcpy(to, from, n * sizeof(double)); }

static void placed() {
  mj_kinematics(model, data);
  mj_comPos(model, data);
}

static void inverse_dynamics(const double* a, double* out) {
  placed();
  copy(data->qacc, a, model->nv);
  mj_comVel(model, data);
  mj_rne(model, data, 1, out);
}

static void forward_dynamics(const double* tau, double* out) {
  static std::vector<double> rest;
  rest.resize(model->nv);
  placed();
  mj_makeM(model, data);
  mj_factorM(model, data);
  mj_comVel(model, data);
  mj_rne(model, data, 0, rest.data());
  for (int k = 0; k < model->nv; ++k) rest[k] = tau[k] - rest[k];
  mj_solveM(model, data, out, rest.data(), 1);
}

static void mass_matrix(const double*, double* out) {
  placed();
  mj_makeM(model, data);
  mj_fullM(model, data, out);
}

static void kinematics(const double*, double* out) {
  mj_kinematics(model, data);
  copy(out, data->xpos, 3 * model->nbody);
  copy(out + 3 * model->nbody, data->xquat, 4 * model->nbody);
}

static void jacobian(const double*, double* out) {
  placed();
  mj_jacBody(model, data, out, out + 3 * model->nv, body);
}

static void step(const double* tau, double* out) {
  copy(data->qfrc_applied, tau, model->nv);
  mj_step(model, data);
  copy(out, data->qpos, model->nq);
  copy(out + model->nq, data->qvel, model->nv);
}

using Algorithm = void (*)(const double*, double*);
static const Algorithm ALGORITHMS[] = {inverse_dynamics, forward_dynamics, mass_matrix, kinematics, jacobian, step};

extern "C" void run(int algorithm, long n, long size, const double* q, const double* v, const double* a,
                    const double* /* cotangent */, double* out) {
  for (long i = 0; i < n; ++i) {
    copy(data->qpos, q + i * model->nq, model->nq);
    copy(data->qvel, v + i * model->nv, model->nv);
    ALGORITHMS[algorithm](a + i * model->nv, out + i * size);
  }
}
