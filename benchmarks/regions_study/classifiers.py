"""Twenty classifiers, from a logistic regression to the nearest neighbour."""

from typing import Any

from sklearn.discriminant_analysis import QuadraticDiscriminantAnalysis
from sklearn.ensemble import GradientBoostingClassifier, RandomForestClassifier
from sklearn.gaussian_process import GaussianProcessClassifier
from sklearn.gaussian_process.kernels import RBF
from sklearn.linear_model import LogisticRegression
from sklearn.naive_bayes import GaussianNB
from sklearn.neighbors import KNeighborsClassifier
from sklearn.neural_network import MLPClassifier
from sklearn.svm import SVC
from sklearn.tree import DecisionTreeClassifier


def classifiers(seed: int) -> dict[str, Any]:
    """Not fitted yet, by name."""
    return {
        "logistic regression": LogisticRegression(),
        "naive Bayes": GaussianNB(),
        "quadratic discriminant": QuadraticDiscriminantAnalysis(),
        "Gaussian process": GaussianProcessClassifier(RBF(1.0), optimizer=None, random_state=seed),
        **{f"tree of depth {d}": DecisionTreeClassifier(max_depth=d, random_state=seed) for d in (2, 4, 8)},
        "full tree": DecisionTreeClassifier(random_state=seed),
        "forest of depth 4": RandomForestClassifier(30, max_depth=4, random_state=seed),
        "forest": RandomForestClassifier(30, random_state=seed),
        "boosted trees": GradientBoostingClassifier(n_estimators=60, max_depth=3, random_state=seed),
        **{f"SVM, gamma {gamma}": SVC(gamma=gamma) for gamma in (0.1, 1.0, 10.0, 100.0)},
        **{f"{k} neighbours": KNeighborsClassifier(k) for k in (1, 5, 25)},
        "network, 8 units": MLPClassifier(8, alpha=1e-2, max_iter=300, solver="lbfgs", random_state=seed),
        "network, 2 x 64 units": MLPClassifier((64, 64), alpha=1e-5, max_iter=300, solver="lbfgs", random_state=seed),
    }
