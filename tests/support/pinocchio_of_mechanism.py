"""Robots with loops in Pinocchio: a model of joint screws, points that meet at the cuts, forces and accelerations.

Shares with jounce: the model, whose screws and inertias it takes.
"""

import warnings

import numpy as np

with warnings.catch_warnings():
    warnings.simplefilter("ignore")
    import pinocchio


class ConstrainedPeer:
    """A mechanism of revolute and prismatic joints, whose loops are closed where the origins of two frames meet.

    A loop of a planar robot that a revolute joint closes is such a loop too: the joint's other constraints hold anyway.
    """

    def __init__(self, mechanism, loops):
        self.model, self.joints = pinocchio.Model(), [0]
        self.model.gravity.linear = mechanism.gravity
        offsets = [np.zeros(3)]  # of the body frame in the frame of its joint, which lies on the axis
        for i, (B, X, M) in enumerate(zip(mechanism.B, mechanism.X, mechanism.M, strict=True)):
            parent, (turns, e) = mechanism.parent[i] + 1, (X[:3].any(), X[:3] if X[:3].any() else X[3:])
            x = np.cross(X[:3], X[3:])  # the point of the axis next to the origin, zero of a sliding joint
            kind = pinocchio.JointModelRevoluteUnaligned if turns else pinocchio.JointModelPrismaticUnaligned
            placed = pinocchio.SE3(B[:3, :3], offsets[parent] + B[:3, 3] + B[:3, :3] @ x)
            joint = self.model.addJoint(self.joints[parent], kind(e), placed, mechanism.joints[i])
            self.joints.append(joint)
            offsets.append(-x)
            m = M[3, 3]
            com = np.array([M[2, 4], M[0, 5], M[1, 3]]) / m if m else np.zeros(3)  # M[:3, 3:] = m hat(com)
            hat = np.cross(np.eye(3), com)
            inertia = pinocchio.Inertia(m, com, M[:3, :3] + m * hat @ hat)
            self.model.appendBodyToJoint(joint, inertia, pinocchio.SE3(np.eye(3), -x))
        self.order = [self.model.joints[joint].idx_v for joint in self.joints[1:]]
        places = [[self._placed(mechanism.frame(name), offsets) for name in loop] for loop in loops]
        self.constraints = pinocchio.StdVec_RigidConstraintModel()
        for a, b in places:
            kind = pinocchio.ContactType.CONTACT_3D
            self.constraints.append(pinocchio.RigidConstraintModel(kind, self.model, *a, *b, pinocchio.LOCAL))
        self.data = self.model.createData()

    def _placed(self, frame, offsets):
        body = frame.body + 1
        T = np.array(frame.T, dtype=float)
        return self.joints[body], pinocchio.SE3(T[:3, :3], offsets[body] + T[:3, 3])

    def _given(self, x):
        given = np.zeros(self.model.nv)
        given[self.order] = x
        return given

    def _constraints(self, q, v):
        """Their Jacobian and the acceleration of the gaps at zero joint accelerations."""
        model, data = self.model, self.data
        pinocchio.forwardKinematics(model, data, q, v, np.zeros(model.nv))
        pinocchio.computeJointJacobians(model, data, q)
        rows, drift = [], []
        for one in self.constraints:
            J1, a1 = self._point(one.joint1_id, one.joint1_placement)
            J2, a2 = self._point(one.joint2_id, one.joint2_placement)
            rows.append(J1 - J2)
            drift.append(a1 - a2)
        return np.concatenate(rows), np.concatenate(drift)

    def _point(self, joint, place):
        """The Jacobian of a point and its acceleration, in the axes of the world."""
        J = pinocchio.getFrameJacobian(self.model, self.data, joint, place, pinocchio.LOCAL_WORLD_ALIGNED)[:3]
        twist, rate = place.actInv(self.data.v[joint]), place.actInv(self.data.a[joint])
        R = self.data.oMi[joint].rotation @ place.rotation
        return J, R @ (rate.linear + np.cross(twist.angular, twist.linear))

    def inverse(self, q, qd, q2d, actuated):
        """The forces of the actuated joints, and all joint accelerations, from those of the actuated joints."""
        q, v = self._given(q), self._given(qd)
        J, drift = self._constraints(q, v)
        S = np.zeros((self.model.nv, len(actuated)))
        S[[self.order[i] for i in actuated], range(len(actuated))] = 1
        M = pinocchio.crba(self.model, self.data, q)
        M = np.triu(M) + np.triu(M, 1).T
        bias = pinocchio.nonLinearEffects(self.model, self.data, q, v)
        a = np.linalg.lstsq(np.concatenate([J, S.T]), np.concatenate([-drift, q2d]), rcond=1e-11)[0]
        found = np.linalg.lstsq(np.concatenate([S, J.T], axis=1), M @ a + bias, rcond=1e-11)[0]
        return found[: len(actuated)], a[self.order]

    def forward(self, q, qd, Q, actuated):
        """All joint accelerations under forces of the actuated joints, by Pinocchio's own constrained dynamics."""
        data = pinocchio.StdVec_RigidConstraintData()
        for one in self.constraints:
            data.append(one.createData())
        tau = np.zeros(self.model.nv)
        tau[[self.order[i] for i in actuated]] = Q
        pinocchio.initConstraintDynamics(self.model, self.data, self.constraints, data)
        settings = pinocchio.ProximalSettings(1e-14, 1e-10, 50)
        given = (self._given(q), self._given(qd), tau, self.constraints, data, settings)
        return np.array(pinocchio.constraintDynamics(self.model, self.data, *given))[self.order]
