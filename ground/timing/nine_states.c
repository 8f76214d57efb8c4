/* The paper's nine-state filter over an arc, equations (3) and (7) to (10), as a C programmer would write it by hand:
   for `ground timing`, a yardstick and nothing else. x = (R, V, dA); Euler; position and velocity measured with
   diagonal noise, one component after the other. P is symmetric: its upper triangle is worked on, all of it is kept. */

#include <math.h>
#include <string.h>

#define P(i, j) p[(i) * 9 + (j)]

static void predict(double *x, double *p, const double *q, double mu, double dt) {
    double r2 = x[0] * x[0] + x[1] * x[1] + x[2] * x[2], r = sqrt(r2), pull = mu / (r2 * r), g[3][3], m[9][9];
    for (int i = 0; i < 3; i++)
        for (int j = 0; j < 3; j++) g[i][j] = dt * pull * (3.0 * x[i] * x[j] / r2 - (i == j));
    for (int j = 0; j < 9; j++)
        for (int i = 0; i < 3; i++) {
            m[i][j] = P(i, j) + dt * P(3 + i, j);
            m[3 + i][j] = P(3 + i, j) + dt * P(6 + i, j) + g[i][0] * P(0, j) + g[i][1] * P(1, j) + g[i][2] * P(2, j);
            m[6 + i][j] = P(6 + i, j);
        }
    for (int i = 0; i < 9; i++) {
        for (int j = 0; j < 3; j++) {
            p[i * 9 + j] = m[i][j] + dt * m[i][3 + j];
            p[i * 9 + 3 + j] = m[i][3 + j] + dt * m[i][6 + j] + g[j][0] * m[i][0] + g[j][1] * m[i][1] + g[j][2] * m[i][2];
            p[i * 9 + 6 + j] = m[i][6 + j];
        }
        p[i * 9 + i] += q[i / 3];
    }
    double a[3];
    for (int i = 0; i < 3; i++) a[i] = x[6 + i] - pull * x[i];
    for (int i = 0; i < 3; i++) {
        x[i] += dt * x[3 + i];
        x[3 + i] += dt * a[i];
    }
}

static void update(double *x, double *p, const double *z, const double *variance) {
    for (int h = 0; h < 6; h++) {
        double c[9], s = 1.0 / (P(h, h) + variance[h]), e = z[h] - x[h];
        for (int i = 0; i < 9; i++) c[i] = P(h, i);
        for (int i = 0; i < 9; i++) {
            double k = c[i] * s;
            x[i] += k * e;
            for (int j = i; j < 9; j++) {
                double v = P(i, j) - k * c[j];
                P(i, j) = v;
                P(j, i) = v;
            }
        }
    }
}

/* n epochs; z (n, 6); q (3) by block; variance (6). x (9) and p (81) in place. */
void arc(long n, const double *z, const double *q, const double *variance, double mu, double dt, double *x, double *p) {
    for (long k = 0; k < n; k++) {
        predict(x, p, q, mu, dt);
        update(x, p, z + 6 * k, variance);
    }
}
