// Light that Lambert triangles scatter twice or more, by plain random paths: a program that shares no code with the engine.
//
//   g++ -O3 -o convergence convergence.cpp && ./convergence TRIANGLES PAIRS COUNT
//
// TRIANGLES: ten numbers to a line, three corners (m) and an albedo. PAIRS: six numbers to a line, unit vectors to the Sun and to the observer.
// COUNT: paths. Prints for each pair I/E (m2/sr) and its standard error, from the differences of two paths in each cell of a grid across the sunlight.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <cstdlib>
#include <vector>

struct Vec { double x, y, z; };
static Vec operator+(Vec a, Vec b) { return {a.x + b.x, a.y + b.y, a.z + b.z}; }
static Vec operator-(Vec a, Vec b) { return {a.x - b.x, a.y - b.y, a.z - b.z}; }
static Vec operator*(double s, Vec a) { return {s * a.x, s * a.y, s * a.z}; }
static double dot(Vec a, Vec b) { return a.x * b.x + a.y * b.y + a.z * b.z; }
static Vec cross(Vec a, Vec b) { return {a.y * b.z - a.z * b.y, a.z * b.x - a.x * b.z, a.x * b.y - a.y * b.x}; }
static Vec unit(Vec a) { return (1 / std::sqrt(dot(a, a))) * a; }
static Vec across(Vec a) { return unit(std::fabs(a.x) < 0.5 ? cross(a, {1, 0, 0}) : cross(a, {0, 1, 0})); }
static double axis(Vec a, int k) { return k == 0 ? a.x : k == 1 ? a.y : a.z; }

struct Triangle { Vec a, e, f, normal; double albedo; };
struct Node { double low[3], high[3]; int left, right, first, count; };
static std::vector<Triangle> triangles;
static std::vector<Node> nodes;
static std::vector<int> order;

static int build(int first, int count) {
    Node node{{1e9, 1e9, 1e9}, {-1e9, -1e9, -1e9}, -1, -1, first, count};
    for (int i = first; i < first + count; i++) {
        const Triangle &t = triangles[order[i]];
        for (Vec p : {t.a, t.a + t.e, t.a + t.f})
            for (int k = 0; k < 3; k++) {
                node.low[k] = std::min(node.low[k], axis(p, k) - 1e-9);
                node.high[k] = std::max(node.high[k], axis(p, k) + 1e-9);
            }
    }
    int id = (int)nodes.size(), widest = 0;
    nodes.push_back(node);
    for (int k = 1; k < 3; k++)
        if (node.high[k] - node.low[k] > node.high[widest] - node.low[widest]) widest = k;
    if (count > 3) {
        auto middle = [&](int i) { const Triangle &t = triangles[i]; return axis(3.0 * t.a + t.e + t.f, widest); };
        auto begin = order.begin() + first;
        std::nth_element(begin, begin + count / 2, begin + count, [&](int i, int j) { return middle(i) < middle(j); });
        int left = build(first, count / 2), right = build(first + count / 2, count - count / 2);
        nodes[id].left = left;
        nodes[id].right = right;
    }
    return id;
}

// xorshift128+ (Vigna 2017).
static uint64_t state[2];
static double uniform() {
    uint64_t a = state[0], b = state[1];
    state[0] = b;
    a ^= a << 23;
    state[1] = a ^ b ^ (a >> 17) ^ (b >> 26);
    return (double)((state[1] + b) >> 11) * 0x1p-53;
}

// The first triangle along a ray, or any; -1 where there is none (Moeller and Trumbore 1997).
static int met(Vec from, Vec along, double &distance, bool any) {
    int stack[64], top = 0, best = -1;
    stack[top++] = 0;
    while (top) {
        const Node &node = nodes[stack[--top]];
        double near = 0, far = distance;
        for (int k = 0; k < 3; k++) {
            double inverse = 1 / axis(along, k);
            double a = (node.low[k] - axis(from, k)) * inverse, b = (node.high[k] - axis(from, k)) * inverse;
            near = std::max(near, std::min(a, b));
            far = std::min(far, std::max(a, b));
        }
        if (near > far * (1 + 1e-12)) continue;
        if (node.left >= 0) {
            stack[top++] = node.left;
            stack[top++] = node.right;
            continue;
        }
        for (int i = node.first; i < node.first + node.count; i++) {
            const Triangle &t = triangles[order[i]];
            Vec p = cross(along, t.f), s = from - t.a, q = cross(s, t.e);
            double determinant = dot(t.e, p);
            if (determinant == 0) continue;
            double u = dot(s, p) / determinant, v = dot(along, q) / determinant, d = dot(t.f, q) / determinant;
            if (u < 0 || v < 0 || u + v > 1 || d <= 1e-9 || d >= distance) continue;
            distance = d;
            best = order[i];
            if (any) return best;
        }
    }
    return best;
}

// Light of one path that comes with the sunlight, but for what is scattered once.
static double path(Vec from, Vec along, Vec to) {
    double got = 0;
    for (int scattered = 1;; scattered++) {
        double distance = 1e9, beyond = 1e9;
        int id = met(from, along, distance, false);
        if (id < 0 || dot(triangles[id].normal, along) >= 0) return got;
        const Triangle &t = triangles[id];
        from = from + distance * along;
        double cosine = dot(t.normal, to);
        if (scattered > 1 && cosine > 0 && met(from, to, beyond, true) < 0) got += t.albedo / M_PI * cosine;
        if (uniform() >= t.albedo) return got;
        double a = uniform(), b = 2 * M_PI * uniform();
        Vec p = across(t.normal), q = cross(t.normal, p);
        along = unit(std::sqrt(a) * (std::cos(b) * p + std::sin(b) * q) + std::sqrt(1 - a) * t.normal);
    }
}

int main(int count, char **arguments) {
    if (count != 4) return std::fprintf(stderr, "usage: convergence TRIANGLES PAIRS COUNT\n"), 2;
    double x[10];
    std::FILE *file = std::fopen(arguments[1], "r");
    if (!file) return std::perror(arguments[1]), 1;
    while (std::fscanf(file, "%lf %lf %lf %lf %lf %lf %lf %lf %lf %lf", x, x + 1, x + 2, x + 3, x + 4, x + 5, x + 6, x + 7, x + 8, x + 9) == 10) {
        Vec a{x[0], x[1], x[2]}, e = Vec{x[3], x[4], x[5]} - a, f = Vec{x[6], x[7], x[8]} - a;
        order.push_back((int)triangles.size());
        triangles.push_back({a, e, f, unit(cross(e, f)), x[9]});
    }
    std::fclose(file);
    build(0, (int)order.size());
    long side = (long)std::sqrt(0.5 * std::atof(arguments[3]));
    file = std::fopen(arguments[2], "r");
    if (!file) return std::perror(arguments[2]), 1;
    while (std::fscanf(file, "%lf %lf %lf %lf %lf %lf", x, x + 1, x + 2, x + 3, x + 4, x + 5) == 6) {
        Vec sun{x[0], x[1], x[2]}, to{x[3], x[4], x[5]}, p = across(sun), q = cross(sun, p);
        state[0] = 0x9e3779b97f4a7c15u;
        state[1] = 12345;
        double low[3] = {1e9, 1e9, 1e9}, high[3] = {-1e9, -1e9, -1e9};
        for (const Triangle &t : triangles)
            for (Vec corner : {t.a, t.a + t.e, t.a + t.f}) {
                double at[3] = {dot(corner, p), dot(corner, q), dot(corner, sun)};
                for (int k = 0; k < 3; k++) low[k] = std::min(low[k], at[k]), high[k] = std::max(high[k], at[k]);
            }
        double area = (high[0] - low[0]) * (high[1] - low[1]), sum = 0, square = 0;
        for (long cell = 0; cell < side * side; cell++) {
            double two[2];
            for (double &one : two) {
                double u = low[0] + (high[0] - low[0]) * ((double)(cell % side) + uniform()) / (double)side;
                double v = low[1] + (high[1] - low[1]) * ((double)(cell / side) + uniform()) / (double)side;
                one = path(u * p + v * q + (high[2] + 1) * sun, -1.0 * sun, to);
            }
            sum += two[0] + two[1];
            square += (two[0] - two[1]) * (two[0] - two[1]);
        }
        double each = area / (2.0 * (double)(side * side));
        std::printf("%.10e %.3e\n", each * sum, each * std::sqrt(square));
        std::fflush(stdout);
    }
}
