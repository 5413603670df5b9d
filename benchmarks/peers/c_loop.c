/* RK4 of the closed loop, as many scenarios at a time as a vector register holds.
   Gains and the polynomial EXP2 (highest power first) come from the command line; so do -DREAL=float or double, and
   -DSCALAR for one scenario at a time. Built with -fsingle-precision-constant for float: no literal is a double. */
#include <string.h>

#if defined SCALAR
#define BYTES sizeof(REAL)
#elif defined __AVX512F__
#define BYTES 64
#elif defined __AVX__
#define BYTES 32
#else
#define BYTES 16
#endif
#define LANES (BYTES / sizeof(REAL))
#define INLINE static inline __attribute__((always_inline))

typedef REAL real;
#ifdef SCALAR
typedef REAL pack;
typedef INTEGER bits;
#define LANE(a, i) (a)
#else
typedef REAL pack __attribute__((vector_size(BYTES)));
typedef INTEGER bits __attribute__((vector_size(BYTES))); /* of the same size as REAL */
#define LANE(a, i) ((a)[i])
#endif
/* gcc makes one instruction of a loop over the lanes */
#define EACH(result, expression) for (int i = 0; i < (int)LANES; i++) LANE(result, i) = (expression)

enum { X, Y, VX, VY, PSI, FX, FY, GX, GY, XI_X, XI_Y, BETA_X, BETA_Y, VARPHI, BETA_PSI, VARPHI_PSI, STATES };
enum { X_D, Y_D, X_D_RATE, Y_D_RATE, PSI_D, PSI_D_RATE, PUSH, SIGNALS };
enum { POSITION = 0, HEADING = 4, AMPLITUDE = 8, PARAMETERS };
static const real polynomial[] = {EXP2}, centers[] = {CENTERS};

INLINE pack positive(pack a) { EACH(a, LANE(a, i) > 0 ? LANE(a, i) : 0); return a; }
INLINE pack negative(pack a) { EACH(a, LANE(a, i) < 0 ? LANE(a, i) : 0); return a; }
INLINE pack at_least(pack a, real low) { EACH(a, LANE(a, i) > low ? LANE(a, i) : low); return a; }
INLINE pack nearest(pack a) { EACH(a, sizeof(real) == 4 ? __builtin_rintf(LANE(a, i)) : __builtin_rint(LANE(a, i))); return a; }

/* 2^t for t <= 0: the polynomial for what is beyond the integer, and the integer added to its exponent. */
INLINE pack power_of_two(pack t) {
  t = at_least(t, sizeof(real) == 4 ? -96 : -960); /* 0 for all purposes, and no product becomes subnormal */
  pack n = nearest(t), r = t - n, value = polynomial[0] + 0 * r;
#pragma GCC unroll 16
  for (int i = 1; i < (int)(sizeof polynomial / sizeof(real)); i++) value = value * r + polynomial[i];
  const int mantissa = sizeof(real) == 4 ? 23 : 52;
  n += (real)(1.5 * ((INTEGER)1 << mantissa)); /* leaves the integer in the low bits */
  bits raised, result;
  memcpy(&raised, &n, sizeof n);
  memcpy(&result, &value, sizeof value);
  result += raised << mantissa;
  memcpy(&value, &result, sizeof value);
  return value;
}

INLINE pack deadzone(pack u, const pack *p) { return p[0] * positive(u - p[2]) + p[1] * negative(u + p[3]); }

/* The derivatives d of the state s; returns the squared error. */
INLINE pack derivative(pack *d, const pack *s, const real *w, const pack *p) {
  const pack z1x = s[X] - w[X_D], z1y = s[Y] - w[Y_D], turned = s[PSI] - w[PSI_D];
  const pack z3 = turned - TURN * nearest(turned * (1 / TURN));
  const pack filtering_x = s[FX] - w[X_D_RATE] + K1 * z1x + LAM * s[BETA_X];
  const pack filtering_y = s[FY] - w[Y_D_RATE] + K1 * z1y + LAM * s[BETA_Y];
  const pack z2x = s[VX] - s[FX], z2y = s[VY] - s[FY];
  pack nodes = 0 * z1x, nodes_psi = nodes;
#pragma GCC unroll 8
  for (int i = 0; i < (int)(sizeof centers / sizeof(real)); i++) {
    const pack dx = s[VX] - centers[i], dy = s[VY] - centers[i], dpsi = s[PSI] - centers[i];
    nodes += power_of_two(STEEPNESS * (dx * dx + dy * dy));
    nodes_psi += power_of_two(STEEPNESS * (dpsi * dpsi));
  }
  nodes *= 1 / (2 * B1 * B1);
  nodes_psi *= 1 / (2 * B2 * B2);
  const pack gain = K2 + s[VARPHI] * nodes, gain_psi = K3 + s[VARPHI_PSI] * nodes_psi;
  const pack delta = p[AMPLITUDE] * w[PUSH];
  const pack omega = deadzone(w[PSI_D_RATE] - gain_psi * z3 - LAM_PSI * s[BETA_PSI], p + HEADING);
  d[X] = s[VX];
  d[Y] = s[VY];
  d[VX] = deadzone(OMEGA_N * s[GX] - gain * z2x, p + POSITION) + delta - omega * s[VY];
  d[VY] = deadzone(OMEGA_N * s[GY] - gain * z2y, p + POSITION) + delta + omega * s[VX];
  d[PSI] = omega + delta;
  d[FX] = OMEGA_N * s[GX];
  d[FY] = OMEGA_N * s[GY];
  d[GX] = -2 * ZETA * OMEGA_N * s[GX] - OMEGA_N * filtering_x;
  d[GY] = -2 * ZETA * OMEGA_N * s[GY] - OMEGA_N * filtering_y;
  d[XI_X] = filtering_x - K1 * s[XI_X];
  d[XI_Y] = filtering_y - K1 * s[XI_Y];
  d[BETA_X] = z1x;
  d[BETA_Y] = z1y;
  d[VARPHI] = GAMMA1 * nodes * (z2x * z2x + z2y * z2y) - ETA1 * s[VARPHI];
  d[BETA_PSI] = z3;
  d[VARPHI_PSI] = GAMMA2 * nodes_psi * (z3 * z3) - ETA2 * s[VARPHI_PSI];
  return z1x * z1x + z1y * z1y + z3 * z3;
}

#define ALL _Pragma("GCC unroll 16") for (int j = 0; j < STATES; j++)

/* Squared error, summed by the trapezoid over n steps of h; s becomes the final state. */
INLINE pack rollout(pack *s, const pack *p, const real *w, long n, real h) {
  pack d[STATES], moved[STATES], sum[STATES], total = -derivative(d, s, w, p) / 2;
  for (long k = 0; k < n; k++, w += 2 * SIGNALS) {
    total += derivative(d, s, w, p);
    ALL sum[j] = d[j], moved[j] = s[j] + h / 2 * d[j];
    derivative(d, moved, w + SIGNALS, p);
    ALL sum[j] += 2 * d[j], moved[j] = s[j] + h / 2 * d[j];
    derivative(d, moved, w + SIGNALS, p);
    ALL sum[j] += 2 * d[j], moved[j] = s[j] + h * d[j];
    derivative(d, moved, w + 2 * SIGNALS, p);
    ALL s[j] += h / 6 * (sum[j] + d[j]);
  }
  return total + derivative(d, s, w, p) / 2;
}

/* start, final: (size, STATES); parameters: (size, PARAMETERS); signals: (2 n + 1, SIGNALS); total: (size). */
void batch(long size, long n, double h, const real *start, const real *parameters, const real *signals, real *total,
           real *final) {
  for (long first = 0; first < size; first += LANES) {
    pack s[STATES], p[PARAMETERS], result;
    for (int i = 0; i < (int)LANES; i++) {
      const long row = first + i < size ? first + i : size - 1; /* the last register may be part empty */
      for (int j = 0; j < STATES; j++) LANE(s[j], i) = start[row * STATES + j];
      for (int j = 0; j < PARAMETERS; j++) LANE(p[j], i) = parameters[row * PARAMETERS + j];
    }
    result = rollout(s, p, signals, n, h);
    for (int i = 0; i < (int)LANES && first + i < size; i++) {
      total[first + i] = LANE(result, i);
      for (int j = 0; j < STATES; j++) final[(first + i) * STATES + j] = LANE(s[j], i);
    }
  }
}
