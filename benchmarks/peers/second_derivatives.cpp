// Pinocchio's tensors of second derivatives, for callers from C: a model of revolute joints about z, and a loop over states.
#include "pinocchio/multibody.hpp"
#include "pinocchio/algorithm/rnea-second-order-derivatives.hpp"

using namespace pinocchio;
using Cube = Data::Tensor3x;
using Vector = Eigen::Map<const Eigen::VectorXd>;

struct Robot {
  Model model;
  Data data;
  Cube tensors[4];  // by (q, q), (v, v), (q, v), (a, q)
};

// Of each body: its parent, its pose (4 x 4, row-major), its mass, center of mass and inertia about that (3 x 3).
extern "C" Robot *make(int n, const int *parents, const double *poses, const double *masses, const double *centers,
                       const double *inertias, const double *gravity) {
  using Matrix3 = Eigen::Matrix<double, 3, 3, Eigen::RowMajor>;
  using Matrix4 = Eigen::Matrix<double, 4, 4, Eigen::RowMajor>;
  auto *robot = new Robot();
  Model &model = robot->model;
  model.gravity.linear() = Eigen::Map<const Eigen::Vector3d>(gravity);
  for (int i = 0; i < n; ++i) {
    Eigen::Map<const Matrix4> pose(poses + 16 * i);
    SE3 place(pose.topLeftCorner<3, 3>(), pose.topRightCorner<3, 1>());
    auto joint = model.addJoint(parents[i] + 1, JointModelRZ(), place, "joint" + std::to_string(i));
    Inertia inertia(masses[i], Eigen::Map<const Eigen::Vector3d>(centers + 3 * i),
                    Symmetric3(Eigen::Matrix3d(Eigen::Map<const Matrix3>(inertias + 9 * i))));
    model.appendBodyToJoint(joint, inertia, SE3::Identity());
  }
  robot->data = Data(model);
  for (auto &tensor : robot->tensors) {
    tensor.resize(n, n, n);
    tensor.setZero();
  }
  return robot;
}

extern "C" void second_derivatives(Robot *robot, int count, const double *q, const double *v, const double *a) {
  int n = robot->model.nv;
  for (int k = 0; k < count; ++k)
    ComputeRNEASecondOrderDerivatives(robot->model, robot->data, Vector(q + k * n, n), Vector(v + k * n, n),
                                      Vector(a + k * n, n), robot->tensors[0], robot->tensors[1], robot->tensors[2],
                                      robot->tensors[3]);
}

extern "C" void last(const Robot *robot, double *out) {  // column-major, one behind the other
  for (const auto &tensor : robot->tensors) out = std::copy(tensor.data(), tensor.data() + tensor.size(), out);
}
