/* Reference kernels: what a C programmer would write for a batch of wrenches, one thread.
   aos: (n, 3) arrays; soa: (3, n) arrays. In place where Drake works in place. */
#include <stddef.h>

#define SHIFT_ONE(t, f, px, py, pz, x, y, z)                                              \
    do {                                                                                  \
        T tx = t[x] - (py * f[z] - pz * f[y]), ty = t[y] - (pz * f[x] - px * f[z]);       \
        t[z] -= px * f[y] - py * f[x], t[x] = tx, t[y] = ty;                              \
    } while (0)

void NAME(shift_aos)(size_t n, T *restrict tau, const T *restrict f, const T *restrict p) {
    for (size_t i = 0; i < 3 * n; i += 3) SHIFT_ONE((tau + i), (f + i), p[i], p[i + 1], p[i + 2], 0, 1, 2);
}

void NAME(shift_soa)(size_t n, T *restrict tau, const T *restrict f, const T *restrict p) {
    const T *f0 = f, *f1 = f + n, *f2 = f + 2 * n, *p0 = p, *p1 = p + n, *p2 = p + 2 * n;
    T *t0 = tau, *t1 = tau + n, *t2 = tau + 2 * n;
    for (size_t i = 0; i < n; i++) {
        t0[i] -= p1[i] * f2[i] - p2[i] * f1[i];
        t1[i] -= p2[i] * f0[i] - p0[i] * f2[i];
        t2[i] -= p0[i] * f1[i] - p1[i] * f0[i];
    }
}

void NAME(shared_aos)(size_t n, T *restrict tau, const T *restrict f, const T *restrict p) {
    const T px = p[0], py = p[1], pz = p[2];
    for (size_t i = 0; i < 3 * n; i += 3) SHIFT_ONE((tau + i), (f + i), px, py, pz, 0, 1, 2);
}

void NAME(shared_soa)(size_t n, T *restrict tau, const T *restrict f, const T *restrict p) {
    const T px = p[0], py = p[1], pz = p[2], *f0 = f, *f1 = f + n, *f2 = f + 2 * n;
    T *t0 = tau, *t1 = tau + n, *t2 = tau + 2 * n;
    for (size_t i = 0; i < n; i++) {
        t0[i] -= py * f2[i] - pz * f1[i];
        t1[i] -= pz * f0[i] - px * f2[i];
        t2[i] -= px * f1[i] - py * f0[i];
    }
}

void NAME(dot_aos)(size_t n, T *restrict power, const T *restrict tau, const T *restrict f, const T *restrict w,
                   const T *restrict v) {
    for (size_t i = 0, k = 0; i < n; i++, k += 3)
        power[i] = (tau[k] * w[k] + tau[k + 1] * w[k + 1] + tau[k + 2] * w[k + 2]) +
                   (f[k] * v[k] + f[k + 1] * v[k + 1] + f[k + 2] * v[k + 2]);
}
